//! Morph targets of a level: each vertex has the displacement of the closest point of the source.

use glam::Vec3;
use rayon::prelude::*;

use super::skin_source::SkinSource;
use crate::animation::corner_weights;
use crate::data::{LevelMorph, MorphTarget, Morphs, Surface, TriMesh};
use crate::geometry::{Hit, first_coincident};

/// The source's morph targets on `mesh`, a level in the rest pose. Empty for a source without morph targets.
pub fn transfer_morphs(source: &SkinSource<'_>, mesh: &TriMesh) -> Vec<LevelMorph> {
    let surface = &source.model.surface;
    let Some(Morphs { targets, .. }) = &surface.morphs else { return Vec::new() };
    let closest = source.closest(mesh);
    let displacements = |target: &MorphTarget| -> Vec<Vec3> {
        let at = |hit: &Hit| {
            let triangle = hit.triangle as usize;
            let barycentric = corner_weights(surface, triangle, hit.point);
            surface.triangles[triangle]
                .iter()
                .zip(barycentric)
                .map(|(&v, weight)| target.displacement(v) * weight)
                .sum()
        };
        closest.iter().map(|hit| hit.as_ref().map_or(Vec3::ZERO, at)).collect()
    };
    let displacements: Vec<Vec<Vec3>> = targets.par_iter().map(displacements).collect();
    with_normals(mesh, targets, displacements)
}

/// The morph targets of a surface, whose normals change with its triangles. Vertices in one place stay alike.
pub fn surface_morphs(surface: &Surface) -> Vec<LevelMorph> {
    let Some(Morphs { targets, .. }) = &surface.morphs else { return Vec::new() };
    let count = surface.positions.len();
    let first = first_coincident(&surface.positions);
    let triangles = surface.triangles.iter().map(|triangle| triangle.map(|v| first[v as usize])).collect();
    let mesh = TriMesh { positions: surface.positions.clone(), triangles };
    let of_target = |target: &MorphTarget| (0..count as u32).map(|v| target.displacement(v)).collect();
    let mut morphs = with_normals(&mesh, targets, targets.par_iter().map(of_target).collect());
    for morph in &mut morphs {
        morph.normals = first.iter().map(|&v| morph.normals[v as usize]).collect();
    }
    morphs
}

/// Adds the changes of the normals to displacements of a mesh in the rest pose.
fn with_normals(mesh: &TriMesh, targets: &[MorphTarget], displacements: Vec<Vec<Vec3>>) -> Vec<LevelMorph> {
    // The mesh without any target. It differs from the rest pose if that has weights.
    let mut bare = mesh.clone();
    for (target, displacements) in targets.iter().zip(&displacements).filter(|(target, _)| target.weight != 0.0) {
        bare.positions.iter_mut().zip(displacements).for_each(|(p, offset)| *p -= *offset * target.weight);
    }
    let bare_normals = bare.vertex_normals();
    let morph = |positions: Vec<Vec3>| {
        let moved = bare.positions.iter().zip(&positions).map(|(p, offset)| *p + *offset).collect();
        let normals = TriMesh { positions: moved, triangles: mesh.triangles.clone() }.vertex_normals();
        LevelMorph { positions, normals: normals.iter().zip(&bare_normals).map(|(n, bare)| *n - *bare).collect() }
    };
    displacements.into_par_iter().map(morph).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Model;
    use crate::geometry::Bvh;

    #[test]
    fn a_vertex_goes_as_far_as_the_point_it_lies_on() {
        // One triangle; the target lifts its second corner by two.
        let displacements = vec![(1, Vec3::Z * 2.0)];
        let target = MorphTarget { name: "lift".into(), weight: 0.0, displacements };
        let surface = Surface {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            material: vec![0],
            morphs: Some(Morphs { node: 0, targets: vec![target, MorphTarget::default()] }),
            ..Surface::default()
        };
        let model = Model { surface, ..Model::empty("flap") };
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let positions = vec![Vec3::new(0.25, 0.25, 0.1), Vec3::X, Vec3::Y];
        let mesh = TriMesh { positions, triangles: vec![[0, 1, 2]] };
        let morphs = transfer_morphs(&SkinSource::new(&model, &bvh), &mesh);
        assert_eq!(morphs.len(), 2);
        let expected = [Vec3::Z * 0.5, Vec3::Z * 2.0, Vec3::ZERO];
        assert!(morphs[0].positions.iter().zip(expected).all(|(p, e)| p.distance(e) < 1e-6), "{morphs:?}");
        assert_eq!(morphs[1].positions, [Vec3::ZERO; 3]);
        assert_eq!(morphs[1].normals, [Vec3::ZERO; 3]);
        assert!(morphs[0].normals[0].x < -0.5);
    }
}
