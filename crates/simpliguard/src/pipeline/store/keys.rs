//! Keys of objects: exactly what a stage reads.

use bytemuck::cast_slice;

use crate::data::Candidate;
use crate::data::{Bone, Document, Influences, Model, Surface, TriMesh};
use crate::settings::{BakeSettings, SourceGeometry, TextureFormat};
use crate::simplify::{Inputs, Params};
use crate::unwrap::UnwrapParams;
use crate::{Key, KeyBuilder, Source, StageId};

/// The content of all files of a source.
pub(crate) fn content_key(source: &Source<'_>, model: &Model) -> Key {
    let Document { buffers, images, .. } = &model.document;
    let key = KeyBuilder::for_stage(StageId::Import).input(source.bytes);
    let key = buffers.iter().fold(key, |key, buffer| key.input(buffer));
    images
        .iter()
        .fold(key, |key, image| match image {
            Some((bytes, _)) => key.input(bytes),
            None => key.missing_input(),
        })
        .finish()
}

/// The shapes of a bake and their deviations.
pub(crate) fn shapes_key(content: &Key, settings: &BakeSettings) -> Key {
    KeyBuilder::for_stage(StageId::Shape)
        .key(content)
        .settings(&settings.canonical(StageId::Reconstruct))
        .settings(&settings.canonical(StageId::Shape))
        .finish()
}

/// The shapes that a candidate leads to.
pub(crate) fn candidate_key(form: &Key, params: &Params, candidate: Candidate) -> Key {
    // Those that choose between candidates make no difference to one.
    let Params {
        budgets,
        reconstruction: _,
        fine: _,
        thick: _,
        finer: _,
        source: _,
        cards: _,
        remove_invisible,
        visible_weight,
        curvature,
        joint_planes,
    } = params;
    let planes =
        if joint_planes.planes.is_empty() { String::new() } else { format!("joint_planes={joint_planes:?}\n") };
    let settings = format!(
        "budgets={budgets:?}\ncurvature={curvature:?}\nremove_invisible={remove_invisible}\nroad={candidate:?}\n\
         visible_weight={visible_weight:?}\n{planes}"
    );
    KeyBuilder::for_stage(StageId::Shape).key(form).settings(settings.as_bytes()).finish()
}

/// Everything that candidates read of a model: its form, how it moves and which of its triangles count, but not its textures.
pub(crate) fn form_key(inputs: &Inputs<'_>) -> Key {
    let key = KeyBuilder::for_stage(StageId::Import);
    let key = with_surface(key, &inputs.model.surface);
    let double_sided: Vec<u8> = inputs.model.materials.iter().map(|m| u8::from(m.double_sided)).collect();
    let key = key.input(&double_sided).input(cast_slice(&inputs.opaque.source));
    let key = inputs.importance.iter().fold(key, |key, importance| key.input(cast_slice(importance.weights())));
    let (Some(poses), Some(rig)) = (inputs.poses, &inputs.model.rig) else { return key.finish() };
    let bone = |Bone { node: _, inverse_bind, rest_world }: &Bone| [*inverse_bind, *rest_world];
    let bones: Vec<_> = rig.bones.iter().map(bone).collect();
    let key = key.input(cast_slice(bones.as_flattened()));
    let key = poses.bones().iter().fold(key, |key, bones| key.input(cast_slice(bones)));
    key.settings(format!("poses={}\n", poses.count()).as_bytes()).finish()
}

fn with_surface(key: KeyBuilder, surface: &Surface) -> KeyBuilder {
    // What is painted counts by the importances that follow from it. Shapes are those of the rest pose and of bones: morph
    // targets play no part.
    let Surface { positions, normals, tangents, uvs, colors, painted: _, influences, triangles, material, morphs: _ } =
        surface;
    let bytes = |Influences { joints, weights }: &Influences| {
        let mut bytes = [0u8; 24];
        bytes[..8].copy_from_slice(cast_slice(joints));
        bytes[8..].copy_from_slice(cast_slice(weights));
        bytes
    };
    let influences: Vec<[u8; 24]> = influences.iter().map(bytes).collect();
    key.input(cast_slice(positions))
        .input(cast_slice(normals))
        .input(cast_slice(tangents))
        .input(cast_slice(&uvs[0]))
        .input(cast_slice(&uvs[1]))
        .input(cast_slice(colors))
        .input(influences.as_flattened())
        .input(cast_slice(triangles))
        .input(cast_slice(material))
}

/// Where descent leaves the vertices of a level.
pub(crate) fn vertices_key(content: &Key, settings: &BakeSettings, budget: u32) -> Key {
    // What is only read when a level is finished.
    let read = BakeSettings {
        normal_map: true,
        source: SourceGeometry::Keep,
        texture_format: TextureFormat::Png,
        ..settings.clone()
    };
    KeyBuilder::for_stage(StageId::Refine)
        .key(content)
        .settings(&read.canonical_bake())
        .settings(format!("budget={budget}\n").as_bytes())
        .finish()
}

/// Where some descent has left the vertices of a mesh.
pub(crate) fn warm_start_key(mesh: &TriMesh) -> Key {
    KeyBuilder::for_stage(StageId::Refine)
        .input(cast_slice(&mesh.positions))
        .input(cast_slice(&mesh.triangles))
        .settings(b"moved\n")
        .finish()
}

/// The atlas of a mesh with a density of texels on each face.
pub(crate) fn atlas_key(mesh: &TriMesh, density: &[f32], params: &UnwrapParams) -> Key {
    let UnwrapParams { size, gutter } = params;
    KeyBuilder::for_stage(StageId::Unwrap)
        .input(cast_slice(&mesh.positions))
        .input(cast_slice(&mesh.triangles))
        .input(cast_slice(density))
        .settings(format!("gutter={gutter}\nsize={size}\n").as_bytes())
        .finish()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::PIPELINE_VERSION;
    use crate::simplify::JointPlanes;
    use crate::skinning::JointPlane;

    fn params() -> Params {
        Params {
            budgets: vec![1000, 2000],
            reconstruction: None,
            fine: None,
            thick: None,
            finer: None,
            source: true,
            cards: true,
            remove_invisible: true,
            visible_weight: 0.9,
            curvature: 0.0,
            joint_planes: JointPlanes::default(),
        }
    }

    #[test]
    fn every_setting_of_a_road_counts() {
        let form = KeyBuilder::new("1").finish();
        let plane = JointPlane { centre: Vec3::ZERO, normal: Vec3::X, reach: 1.0, joints: [0, 1] };
        let planes = JointPlanes { planes: vec![plane], split: true };
        let keys = [
            candidate_key(&form, &params(), Candidate::Source),
            candidate_key(&form, &params(), Candidate::Cards),
            candidate_key(&KeyBuilder::new("2").finish(), &params(), Candidate::Source),
            candidate_key(&form, &Params { budgets: vec![1000], ..params() }, Candidate::Source),
            candidate_key(&form, &Params { remove_invisible: false, ..params() }, Candidate::Source),
            candidate_key(&form, &Params { visible_weight: 0.8, ..params() }, Candidate::Source),
            candidate_key(&form, &Params { curvature: 0.5, ..params() }, Candidate::Source),
            candidate_key(&form, &Params { joint_planes: planes, ..params() }, Candidate::Source),
        ];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[..i].iter().all(|b| a != b), "key {i} is not new");
        }
        assert_eq!(keys[0], candidate_key(&form, &Params { source: false, ..params() }, Candidate::Source));
    }

    #[test]
    fn later_settings_are_in_no_key_of_shapes() {
        let key = |settings: &BakeSettings| shapes_key(&KeyBuilder::new("1").finish(), settings);
        let base = BakeSettings::default();
        for later in [
            BakeSettings { texture_size: 64, ..base.clone() },
            BakeSettings { gutter: 2, ..base.clone() },
            BakeSettings { normal_map: false, ..base.clone() },
            BakeSettings { texture_format: TextureFormat::Jpeg(90), ..base.clone() },
            BakeSettings { refine_steps: 1, ..base.clone() },
        ] {
            assert_eq!(key(&later), key(&base), "{later:?}");
        }
        for own in [
            BakeSettings { faces: vec![9], ..base.clone() },
            BakeSettings { views: 8, ..base.clone() },
            BakeSettings { watertight: true, ..base.clone() },
        ] {
            assert_ne!(key(&own), key(&base), "{own:?}");
        }
    }

    #[test]
    fn only_settings_of_the_finish_are_in_no_key_of_descent() {
        let key = |settings: &BakeSettings| vertices_key(&KeyBuilder::new("1").finish(), settings, 1000);
        let base = BakeSettings::default();
        assert_eq!(key(&BakeSettings { normal_map: false, ..base.clone() }), key(&base));
        assert_eq!(key(&BakeSettings { source: SourceGeometry::Drop, ..base.clone() }), key(&base));
        assert_eq!(key(&BakeSettings { texture_format: TextureFormat::Jpeg(90), ..base.clone() }), key(&base));
        assert_ne!(key(&BakeSettings { gutter: 2, ..base.clone() }), key(&base));
        assert_ne!(vertices_key(&KeyBuilder::new("1").finish(), &base, 2000), key(&base));
    }

    /// Fails when the encoding changes, or when a version is raised: then these become the new ones.
    #[test]
    fn the_encoding_is_stable() {
        let mesh = TriMesh { positions: vec![Vec3::X, Vec3::Y, Vec3::Z], triangles: vec![[0, 1, 2]] };
        let candidate = Candidate::Reconstruction(crate::data::Reconstruction::new(128));
        let keys = [
            candidate_key(&KeyBuilder::new("1").finish(), &params(), candidate),
            atlas_key(&mesh, &[], &UnwrapParams { size: 512, gutter: 4 }),
        ];
        assert_eq!(
            (PIPELINE_VERSION, keys.map(|key| key.hex()[..16].to_owned())),
            ("9", ["4ed6cb81e8ff82ea", "8528248e22b1cdf4"].map(str::to_owned))
        );
    }
}
