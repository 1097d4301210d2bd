//! How far a mesh collapses and passes through itself where its limbs bend (SimpliGuard, Figure 10).
//!
//! Every hinge of the rig is turned on its own, everything that hangs on it with it. What lies rigidly on either side of
//! the hinge encloses as much volume with the hinge's centre as before; what is lost is lost at the bend. Hinges too small to
//! show in a level, such as those of fingers, are left out.

use std::f64::consts::PI;

use glam::{DVec3, Quat, Vec3};
use rayon::prelude::*;
use simpliguard::animation::{LinearBlend, Skeleton};
use simpliguard::data::{Influences, Model, TriMesh};
use simpliguard::geometry::self_intersecting;

/// Weight on either side of a hinge from which on a vertex belongs to the bend.
const BLENDED: f32 = 0.02;
/// Least part of the source's area at a hinge, and least part of it that a limb has.
const LEAST_AREA: f64 = 0.005;
/// One hinge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Number of its joint in [`Skeleton`].
    pub joint: usize,
    /// What it turns around.
    pub axis: Vec3,
    /// Mean distance of the source's surface at the bend from the hinge's centre, in metres.
    pub radius: f32,
}

/// What becomes of a mesh at one hinge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bend {
    /// Volume lost at the bend, as a part of the ball of [`Hinge::radius`]; below zero if it swells.
    pub volume_loss: f64,
    /// Part of the area at the bend whose faces pass through others and did not at rest.
    pub crossing: f64,
}

/// The hinges of a model: joints that hang on another, with a part of the surface between the two.
pub fn hinges(model: &Model) -> Vec<Hinge> {
    let Some(joints) = Skeleton::of(model) else { return Vec::new() };
    let surface = &model.surface;
    let mesh = TriMesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
    let least = LEAST_AREA * area(&mesh, 0..mesh.triangles.len());
    let is_on = |t: usize, joint: usize| {
        let heaviest = surface.influences[surface.triangles[t][0] as usize].joints[0];
        joints.hangs_on(joints.of_bone(heaviest), joint)
    };
    let hinge = |joint: usize| {
        joints.parent(joint)?;
        let bend = bend_at(&joints, joint, &mesh, &surface.influences);
        let limb = (0..mesh.triangles.len()).filter(|&t| is_on(t, joint));
        if area(&mesh, bend.iter().copied()) < least || area(&mesh, limb) < least {
            return None;
        }
        let place = joints.place(joint);
        let corners = bend.iter().flat_map(|&t| mesh.triangles[t]).map(|v| mesh.positions[v as usize]);
        let radius = corners.map(|p| p.distance(place)).sum::<f32>() / (3 * bend.len()) as f32;
        let axis = joints.hinge_axis(joint)?;
        (radius > 0.0).then_some(Hinge { joint, axis, radius })
    };
    (0..joints.count()).filter_map(hinge).collect()
}

/// Of some faces of a mesh, in square metres.
fn area(mesh: &TriMesh, faces: impl IntoIterator<Item = usize>) -> f64 {
    faces.into_iter().map(|t| 0.5 * f64::from(mesh.area_vector(t).length())).sum()
}

/// The positions of a mesh in the rest pose, moved by a turn of one hinge by `angle`, in radians.
pub fn bent(model: &Model, hinge: &Hinge, angle: f32, positions: &[Vec3], influences: &[Influences]) -> Vec<Vec3> {
    let (Some(joints), Some(skinning)) = (Skeleton::of(model), LinearBlend::of(model)) else {
        return positions.to_vec();
    };
    let pose = joints.turned(hinge.joint, Quat::from_axis_angle(hinge.axis, angle));
    let motions = skinning.motions(&skinning.bones(&pose), &skinning.bind(influences));
    positions.iter().zip(motions).map(|(p, motion)| motion.transform_point3(*p)).collect()
}

/// What becomes of a mesh in the rest pose as each hinge is turned by `angle`, in radians, in their order.
pub fn bends(model: &Model, hinges: &[Hinge], angle: f32, mesh: &TriMesh, influences: &[Influences]) -> Vec<Bend> {
    let Some(joints) = Skeleton::of(model) else { return Vec::new() };
    let before = self_intersecting(mesh);
    let one = |hinge: &Hinge| {
        let bend = bend_at(&joints, hinge.joint, mesh, influences);
        let positions = bent(model, hinge, angle, &mesh.positions, influences);
        let centre = joints.place(hinge.joint);
        let volume = |positions: &[Vec3]| cone_volume(centre, &bend, &mesh.triangles, positions);
        let lost = volume(&mesh.positions) - volume(&positions);
        let after = self_intersecting(&TriMesh { positions, triangles: mesh.triangles.clone() });
        let crossed = bend.iter().copied().filter(|&t| after[t] && !before[t]);
        let ball = 4.0 / 3.0 * PI * f64::from(hinge.radius).powi(3);
        let crossing = area(mesh, crossed) / area(mesh, bend.iter().copied()).max(f64::MIN_POSITIVE);
        Bend { volume_loss: lost / ball, crossing }
    };
    hinges.par_iter().map(one).collect()
}

/// The faces that a turn of the joint deforms.
fn bend_at(joints: &Skeleton<'_>, joint: usize, mesh: &TriMesh, influences: &[Influences]) -> Vec<usize> {
    let hanging: Vec<f32> = influences
        .iter()
        .map(|i| {
            let slots = i.joints.iter().zip(i.weights);
            slots.filter(|(bone, _)| joints.hangs_on(joints.of_bone(**bone), joint)).map(|(_, weight)| weight).sum()
        })
        .collect();
    let deformed = |t: &usize| {
        let weights = mesh.triangles[*t].map(|v| hanging[v as usize]);
        let (low, high) = (weights.iter().copied().fold(1.0, f32::min), weights.iter().copied().fold(0.0, f32::max));
        high > BLENDED && low < 1.0 - BLENDED
    };
    (0..mesh.triangles.len()).filter(deformed).collect()
}

/// Signed volume between faces and a point, in cubic metres.
fn cone_volume(centre: Vec3, faces: &[usize], triangles: &[[u32; 3]], positions: &[Vec3]) -> f64 {
    let cone = |&t: &usize| {
        let [a, b, c]: [DVec3; 3] = triangles[t].map(|v| (positions[v as usize] - centre).as_dvec3());
        a.dot(b.cross(c)) / 6.0
    };
    faces.iter().map(cone).sum()
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, TAU};

    use glam::Mat4;
    use simpliguard::data::{Bone, Rig, Surface};

    use super::*;

    /// A closed cylinder of radius 1 around x from -4 to 4, two bones that meet at the origin; within `blend` of it
    /// weights run from one to the other.
    fn cylinder(rings: u32, blend: f32) -> Model {
        const SIDES: u32 = 24;
        let mut surface = Surface::default();
        let mut add = |p: Vec3| {
            let second = if blend > 0.0 { (0.5 + 0.5 * p.x / blend).clamp(0.0, 1.0) } else { f32::from(p.x >= 0.0) };
            surface.positions.push(p);
            let (heavy, joints) = if second > 0.5 { (second, [1, 0, 0, 0]) } else { (1.0 - second, [0, 1, 0, 0]) };
            surface.influences.push(Influences { joints, weights: [heavy, 1.0 - heavy, 0.0, 0.0] });
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
    fn the_bend_is_as_large_as_the_limb_is_thick() {
        // Faces within one and a half radii of the hinge bend: corners at a distance of 1 along the limb and 1 across.
        let radius = hinges(&cylinder(16, 1.0))[0].radius;
        assert!((1.0..2.0f32.sqrt()).contains(&radius), "{radius}");
    }

    #[test]
    fn a_limb_too_small_to_show_is_no_hinge() {
        let mut model = cylinder(16, 1.0);
        model.surface.positions.extend([Vec3::X * 100.0, Vec3::Y * 100.0, Vec3::Z * 100.0]);
        model.surface.influences.extend([Influences::rigid(0); 3]);
        let last = model.surface.positions.len() as u32;
        model.surface.triangles.push([last - 3, last - 2, last - 1]);
        assert_eq!(hinges(&model), []);
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
