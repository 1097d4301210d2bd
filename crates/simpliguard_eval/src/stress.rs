//! How far a mesh collapses and passes through itself where its limbs bend (SimpliGuard, Figure 10).
//!
//! Every hinge of the rig is turned on its own, everything that hangs on it with it. What lies rigidly on either side of
//! the hinge encloses as much volume with the hinge's centre as before; what is lost is lost at the bend.

use glam::{DVec3, Quat, Vec3};
use rayon::prelude::*;
use simpliguard::mesh::{TriMesh, self_intersecting};
use simpliguard::model::{Influences, Model};
use simpliguard::rig::{Joints, Skinning};

/// Weight on either side of a hinge from which on a vertex belongs to the bend.
const BLENDED: f32 = 0.02;
/// Fewest vertices of the source at a hinge.
const FEWEST: usize = 8;
/// Sine of the angle between the bones at a hinge from which on the limb is bent at rest.
const BENT: f32 = 0.1;

/// One hinge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Number of its joint in [`Joints`].
    pub joint: usize,
    /// What it turns around.
    pub axis: Vec3,
    /// Volume that the source's surface at the bend encloses with the hinge's centre, in cubic metres.
    pub volume: f64,
}

/// What becomes of a mesh at one hinge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bend {
    /// Volume lost at the bend, as a part of [`Hinge::volume`]; below zero if it swells.
    pub volume_loss: f64,
    /// Part of the faces at the bend that pass through others and did not at rest.
    pub crossing: f64,
}

/// The hinges of a model: joints that hang on another, with a part of the surface between the two.
pub fn hinges(model: &Model) -> Vec<Hinge> {
    let Some(joints) = Joints::of(model) else { return Vec::new() };
    let mesh = TriMesh { positions: model.surface.positions.clone(), triangles: model.surface.triangles.clone() };
    let hinge = |joint: usize| {
        let parent = joints.parent(joint)?;
        let bend = bend_at(&joints, joint, &mesh, &model.surface.influences);
        let own = |i: &&Influences| joints.of_bone(i.joints[0]) == joint;
        let vertices = model.surface.influences.iter().filter(own).count();
        let volume = cone_volume(joints.place(joint), &bend, &mesh.positions).abs();
        let limb = joints.axis(joint);
        let before = (joints.place(joint) - joints.place(parent)).normalize_or_zero();
        let normal = before.cross(limb);
        let axis =
            if normal.length() > BENT { normal.normalize() } else { limb.try_normalize()?.any_orthonormal_vector() };
        (vertices >= FEWEST && bend.len() >= FEWEST && volume > 0.0).then_some(Hinge { joint, axis, volume })
    };
    (0..joints.count()).filter_map(hinge).collect()
}

/// The positions of a mesh in the rest pose, moved by a turn of one hinge by `angle`, in radians.
pub fn bent(model: &Model, hinge: &Hinge, angle: f32, positions: &[Vec3], influences: &[Influences]) -> Vec<Vec3> {
    let (Some(joints), Some(skinning)) = (Joints::of(model), Skinning::of(model)) else { return positions.to_vec() };
    let pose = joints.turned(hinge.joint, Quat::from_axis_angle(hinge.axis, angle));
    let motions = skinning.motions(&skinning.bones(&pose), influences);
    positions.iter().zip(motions).map(|(p, motion)| motion.transform_point3(*p)).collect()
}

/// What becomes of a mesh in the rest pose as each hinge is turned by `angle`, in radians, in their order.
pub fn bends(model: &Model, hinges: &[Hinge], angle: f32, mesh: &TriMesh, influences: &[Influences]) -> Vec<Bend> {
    let Some(joints) = Joints::of(model) else { return Vec::new() };
    let crossing = |mesh: &TriMesh| self_intersecting(mesh);
    let before = crossing(mesh);
    let one = |hinge: &Hinge| {
        let bend = bend_at(&joints, hinge.joint, mesh, influences);
        let positions = bent(model, hinge, angle, &mesh.positions, influences);
        let centre = joints.place(hinge.joint);
        let lost = cone_volume(centre, &bend, &mesh.positions) - cone_volume(centre, &bend, &positions);
        let after = crossing(&TriMesh { positions, triangles: mesh.triangles.clone() });
        let crossed = after.iter().zip(&before).filter(|(after, before)| **after && !**before).count();
        Bend { volume_loss: lost / hinge.volume, crossing: crossed as f64 / bend.len().max(1) as f64 }
    };
    hinges.par_iter().map(one).collect()
}

/// The faces that a turn of the joint deforms.
fn bend_at(joints: &Joints<'_>, joint: usize, mesh: &TriMesh, influences: &[Influences]) -> Vec<[u32; 3]> {
    let hanging: Vec<f32> = influences
        .iter()
        .map(|i| {
            let slots = i.joints.iter().zip(i.weights);
            slots.filter(|(bone, _)| joints.hangs_on(joints.of_bone(**bone), joint)).map(|(_, weight)| weight).sum()
        })
        .collect();
    let deformed = |t: &&[u32; 3]| {
        let weights = t.map(|v| hanging[v as usize]);
        let (low, high) = (weights.iter().copied().fold(1.0, f32::min), weights.iter().copied().fold(0.0, f32::max));
        high > BLENDED && low < 1.0 - BLENDED
    };
    mesh.triangles.iter().filter(deformed).copied().collect()
}

/// Signed volume between faces and a point, in cubic metres.
fn cone_volume(centre: Vec3, faces: &[[u32; 3]], positions: &[Vec3]) -> f64 {
    let cone = |t: &[u32; 3]| {
        let [a, b, c]: [DVec3; 3] = t.map(|v| (positions[v as usize] - centre).as_dvec3());
        a.dot(b.cross(c)) / 6.0
    };
    faces.iter().map(cone).sum()
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, TAU};

    use glam::Mat4;
    use simpliguard::model::{Bone, Rig, Surface};

    use super::*;

    /// A closed cylinder of radius 1 around x from -4 to 4, two bones that meet at the origin; within `blend` of it
    /// weights run from one to the other.
    fn cylinder(rings: u32, blend: f32) -> Model {
        const SIDES: u32 = 24;
        let mut surface = Surface::default();
        let mut add = |p: Vec3| {
            let second = if blend > 0.0 { (0.5 + 0.5 * p.x / blend).clamp(0.0, 1.0) } else { f32::from(p.x >= 0.0) };
            surface.positions.push(p);
            surface.influences.push(Influences { joints: [0, 1, 0, 0], weights: [1.0 - second, second, 0.0, 0.0] });
        };
        for ring in 0..=rings {
            let x = 8.0 * ring as f32 / rings as f32 - 4.0;
            (0..SIDES).for_each(|k| {
                let angle = TAU * k as f32 / SIDES as f32;
                add(Vec3::new(x, angle.cos(), angle.sin()));
            });
        }
        add(Vec3::X * -4.0);
        add(Vec3::X * 4.0);
        for (ring, k) in (0..rings).flat_map(|ring| (0..SIDES).map(move |k| (ring, k))) {
            let [a, b] = [k, (k + 1) % SIDES].map(|k| ring * SIDES + k);
            surface.triangles.extend([[a, b + SIDES, a + SIDES], [a, b, b + SIDES]]);
        }
        let first_cap = (rings + 1) * SIDES;
        for k in 0..SIDES {
            let (a, b) = (k, (k + 1) % SIDES);
            surface.triangles.push([first_cap, b, a]);
            surface.triangles.push([first_cap + 1, rings * SIDES + a, rings * SIDES + b]);
        }
        let bone = |node: usize, x: f32| Bone {
            node,
            inverse_bind: Mat4::from_translation(-Vec3::X * x),
            rest_world: Mat4::from_translation(Vec3::X * x),
        };
        let rig = Rig { bones: vec![bone(0, -4.0), bone(1, 0.0)], source_skin: Some(0), poses: Vec::new() };
        let mut model = Model { surface, rig: Some(rig), ..Model::empty("cylinder") };
        model.document.json = r#"{"nodes": [{"children": [1]}, {}]}"#.parse().expect("JSON");
        model
    }

    fn mesh(model: &Model) -> TriMesh {
        TriMesh { positions: model.surface.positions.clone(), triangles: model.surface.triangles.clone() }
    }

    fn bend(model: &Model, angle: f32) -> Bend {
        let hinges = hinges(model);
        assert_eq!((hinges.len(), hinges[0].joint), (1, 1));
        assert!(hinges[0].axis.dot(Vec3::X).abs() < 1e-6);
        bends(model, &hinges, angle, &mesh(model), &model.surface.influences)[0]
    }

    #[test]
    fn a_cylinder_at_rest_loses_nothing() {
        let Bend { volume_loss, crossing } = bend(&cylinder(16, 1.0), 0.0);
        assert!(volume_loss.abs() < 1e-6 && crossing == 0.0, "{volume_loss} {crossing}");
    }

    #[test]
    fn the_volume_at_the_bend_is_that_of_the_cylinder_between_its_rings() {
        // Faces within one and a half radii of the hinge bend: their cones make the cylinder without its two end discs.
        let model = cylinder(16, 1.0);
        let circle = 0.5 * 24.0 * f64::from((TAU / 24.0).sin());
        // The cone over the side of a cylinder of length 2 is two thirds of it.
        let expected = circle * 2.0 * 2.0 / 3.0;
        let volume = hinges(&model)[0].volume;
        assert!((volume / expected - 1.0).abs() < 1e-3, "{volume} {expected}");
    }

    #[test]
    fn a_cylinder_loses_more_the_farther_it_bends() {
        let model = cylinder(32, 1.0);
        let losses = [0.25, 0.5, 1.0].map(|part| bend(&model, part * FRAC_PI_2).volume_loss);
        assert!(losses[0] > 0.0 && losses.is_sorted(), "{losses:?}");
        // Blending matrices shrinks the section at a right angle by the cosine of half of it, at most.
        assert!(losses[2] < 0.5, "{losses:?}");
    }

    #[test]
    fn a_sharp_bend_passes_through_itself_and_no_bend_does_not() {
        let model = cylinder(64, 0.0);
        assert!(bend(&model, 2.0).crossing > 0.1);
        assert_eq!(bend(&model, 0.1).crossing, 0.0);
    }
}
