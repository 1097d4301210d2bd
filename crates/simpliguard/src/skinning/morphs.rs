//! Morph targets of a level: each vertex goes as far as the closest point of the source does.

use glam::Vec3;
use rayon::prelude::*;

use super::SkinSource;
use crate::animation::corner_weights;
use crate::data::{LevelMorph, MorphTarget, Morphs, TriMesh};
use crate::geometry::Hit;

/// The source's morph targets on `mesh`, a level in the rest pose; empty for a source without any.
pub fn transfer_morphs(skin_source: &SkinSource<'_>, mesh: &TriMesh) -> Vec<LevelMorph> {
    let surface = &skin_source.model.surface;
    let Some(Morphs { targets, .. }) = &surface.morphs else { return Vec::new() };
    let closest = skin_source.closest(mesh);
    let moves = |target: &MorphTarget| -> Vec<Vec3> {
        let at = |hit: &Hit| {
            let parts = corner_weights(surface, hit.triangle as usize, hit.point);
            surface.triangles[hit.triangle as usize]
                .iter()
                .zip(parts)
                .map(|(&v, part)| target.displacement(v) * part)
                .sum()
        };
        closest.iter().map(|hit| hit.as_ref().map_or(Vec3::ZERO, at)).collect()
    };
    let moves: Vec<Vec<Vec3>> = targets.par_iter().map(moves).collect();
    // Without any target, which is not the rest pose if that has weights.
    let mut bare = mesh.clone();
    for (target, moves) in targets.iter().zip(&moves).filter(|(target, _)| target.weight != 0.0) {
        bare.positions.iter_mut().zip(moves).for_each(|(p, offset)| *p -= *offset * target.weight);
    }
    let bare_normals = bare.vertex_normals();
    let morph = |positions: Vec<Vec3>| {
        let moved = bare.positions.iter().zip(&positions).map(|(p, offset)| *p + *offset).collect();
        let normals = TriMesh { positions: moved, triangles: mesh.triangles.clone() }.vertex_normals();
        LevelMorph { positions, normals: normals.iter().zip(&bare_normals).map(|(n, bare)| *n - *bare).collect() }
    };
    moves.into_par_iter().map(morph).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Model, Surface};
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
