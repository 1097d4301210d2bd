//! The keys of objects: versions, parameters, and the keys or the content of the inputs.

use bytemuck::cast_slice;
use simpliguard_key::{Key, KeyBuilder};

use crate::data::{Bone, Candidate, Document, Influences, Model, Surface, TriMesh};
use crate::gltf::external_uris;
use crate::pipeline::params::{LevelParams, Params};
use crate::pipeline::source::PreparedSource;
use crate::pipeline::stage::{STAGES, Stage};
use crate::pipeline::texture_sizes::LevelView;
use crate::settings::{AtlasSize, BakeSettings, Scope};
use crate::simplify::SimplifyParams;
use crate::skinning::JointPlane;
use crate::unwrap::UnwrapParams;
use crate::{Error, PIPELINE_VERSION, Source, StageId};

/// Starts a key with the versions of the pipeline and of some of its stages.
fn for_stages(ids: &[StageId]) -> KeyBuilder {
    let with_stage = |key: KeyBuilder, id: &StageId| key.stage(&id.to_string(), Stage::of(*id).version);
    ids.iter().fold(KeyBuilder::new(PIPELINE_VERSION), with_stage)
}

/// The key of a bake: over the versions of the pipeline and its stages, the content of all files of the source, and the
/// parameters. Reads the external files of a glTF, but imports nothing. No path, thread count or backend is part of it.
///
/// # Errors
/// [`Error::Invalid`] if the source is no glTF.
pub fn bake_key(source: &Source<'_>, settings: &BakeSettings) -> Result<Key, Error> {
    let mut key = for_stages(&STAGES.map(|stage| stage.id)).input(source.bytes);
    for uri in external_uris(source.name, source.bytes)? {
        key = match source.resources.read(&uri) {
            Ok(bytes) => key.input(&bytes),
            Err(_) => key.missing_input(),
        };
    }
    let key = key.params(&Params::new(settings));
    let key = match settings.scope {
        Scope::Scene => key,
        Scope::Objects => {
            let key = key.params(&(settings.scope, &settings.objects, settings.object_faces));
            let key = if settings.object_rules.is_empty() { key } else { key.params(&settings.object_rules) };
            let key = if settings.whole.0.is_empty() { key } else { key.params(&("whole", &settings.whole)) };
            match settings.shared_atlas {
                AtlasSize::Off => key,
                AtlasSize::Texels(side) => key.params(&("shared_atlas", side)),
            }
        }
    };
    Ok(key.finish())
}

/// The content of all files of a source.
pub(crate) fn content_key(source: &Source<'_>, model: &Model) -> Key {
    let Document { buffers, images, .. } = &model.document;
    let key = for_stages(&[StageId::Import]).input(source.bytes);
    let key = buffers.iter().fold(key, |key, buffer| key.input(buffer));
    let with_image = |key: KeyBuilder, image: &Option<(bytes::Bytes, _)>| match image {
        Some((bytes, _)) => key.input(bytes),
        None => key.missing_input(),
    };
    images.iter().fold(key, with_image).finish()
}

/// The files of a source whose lattices become cards.
pub(crate) fn lattices_key(content: &Key) -> Key {
    for_stages(&[StageId::Import]).key(content).params(&"lattices").finish()
}

/// The selected shapes of a bake and their deviations.
pub(crate) fn shapes_key(content: &Key, simplify: &SimplifyParams, params: &Params) -> Key {
    for_stages(&[StageId::Views, StageId::Reconstruct, StageId::Simplify])
        .key(content)
        .params(simplify)
        .params(&params.views)
        .params(&params.importance)
        .params(&params.joint_planes)
        .finish()
}

/// The shapes of one candidate. Parameters that select candidates make no difference to it.
pub(crate) fn candidate_key(form: &Key, params: &SimplifyParams, candidate: Candidate) -> Key {
    let SimplifyParams { budgets, candidates: _, collapse } = params;
    for_stages(&[StageId::Reconstruct, StageId::Simplify])
        .key(form)
        .params(budgets)
        .params(collapse)
        .params(&candidate)
        .finish()
}

/// Everything that candidates read of a source: its form, its motion and the weights of its triangles, but no textures.
pub(crate) fn form_key(source: &PreparedSource<'_>) -> Key {
    let model = source.index.model;
    let key = with_surface(for_stages(&[StageId::Import]), &model.surface);
    let double_sided: Vec<u8> = model.materials.iter().map(|m| u8::from(m.double_sided)).collect();
    let key = key.input(&double_sided).input(cast_slice(&source.index.opaque.source));
    let key = source.importance.iter().fold(key, |key, importance| key.input(cast_slice(importance.weights())));
    let key = with_joint_planes(key, &source.joint_planes);
    let (Some(poses), Some(rig)) = (&source.index.poses, &model.rig) else { return key.finish() };
    let bone = |Bone { node: _, inverse_bind, rest_world }: &Bone| [*inverse_bind, *rest_world];
    let bones: Vec<_> = rig.bones.iter().map(bone).collect();
    let key = key.input(cast_slice(bones.as_flattened()));
    let key = poses.bones().iter().fold(key, |key, bones| key.input(cast_slice(bones)));
    key.params(&poses.count()).finish()
}

fn with_joint_planes(key: KeyBuilder, planes: &[JointPlane]) -> KeyBuilder {
    let with_plane = |key: KeyBuilder, JointPlane { centre, normal, reach, joints }: &JointPlane| {
        key.params(&(centre.to_array(), normal.to_array(), reach, joints))
    };
    planes.iter().fold(key, with_plane)
}

fn with_surface(key: KeyBuilder, surface: &Surface) -> KeyBuilder {
    // Paint counts by the weights that follow from it. Shapes are those of the rest pose and of bones: morph targets play no
    // part.
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

/// Which of its shapes a level is made from, by pictures of unrefined levels with an atlas and an initial texture.
/// `params` are those of such a draft.
pub(crate) fn choice_key(shapes: &Key, params: &Params, budget: u32) -> Key {
    let params = params.level(budget, LevelView::default());
    for_stages(&[StageId::Unwrap, StageId::Texture, StageId::Maps])
        .key(shapes)
        .params(&params.unwrap)
        .params(&params.texture.initial)
        .params(&(budget, "choice"))
        .finish()
}

/// The refined vertices of a level, with its influences: of its best shape, or of the runner-up.
pub(crate) fn vertices_key(shapes: &Key, params: &LevelParams, budget: u32, is_runner_up: bool) -> Key {
    for_stages(&[StageId::Unwrap, StageId::Skinning, StageId::Texture, StageId::Refine])
        .key(shapes)
        .params(params)
        .params(&(budget, is_runner_up))
        .finish()
}

/// Vertices of a mesh after some refinement, whatever views they were fitted to.
pub(crate) fn warm_start_key(mesh: &TriMesh) -> Key {
    with_mesh(for_stages(&[StageId::Refine]), mesh).params(&"warm start").finish()
}

/// The atlas of a mesh with a relative texel density of each face.
pub(crate) fn atlas_key(mesh: &TriMesh, density: &[f32], params: &UnwrapParams) -> Key {
    with_mesh(for_stages(&[StageId::Unwrap]), mesh).input(cast_slice(density)).params(params).finish()
}

fn with_mesh(key: KeyBuilder, mesh: &TriMesh) -> KeyBuilder {
    key.input(cast_slice(&mesh.positions)).input(cast_slice(&mesh.triangles))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::data::{Reconstruction, TextureFormat};
    use crate::settings::{Budgets, SourceGeometry};
    use crate::simplify::{CollapseParams, SimplifyParams};
    use crate::{NoResources, RelativeUri, Resources};

    fn simplify() -> SimplifyParams {
        let params = Params::new(&BakeSettings::default());
        SimplifyParams { budgets: vec![1000, 2000], candidates: params.candidates, collapse: params.collapse }
    }

    fn some_key(name: &str) -> Key {
        KeyBuilder::new(name).finish()
    }

    #[test]
    fn every_parameter_of_a_candidate_counts() {
        let form = some_key("1");
        let collapse = |collapse: CollapseParams| SimplifyParams { collapse, ..simplify() };
        let of = |params: &SimplifyParams| candidate_key(&form, params, Candidate::Source);
        let base = simplify().collapse;
        let keys = [
            of(&simplify()),
            candidate_key(&form, &simplify(), Candidate::Cards),
            candidate_key(&some_key("2"), &simplify(), Candidate::Source),
            of(&SimplifyParams { budgets: vec![1000], ..simplify() }),
            of(&collapse(CollapseParams { remove_invisible: false, ..base })),
            of(&collapse(CollapseParams { visible_weight: 0.8, ..base })),
            of(&collapse(CollapseParams { curvature: 0.5, ..base })),
            of(&collapse(CollapseParams { split_at_joints: true, ..base })),
        ];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[..i].iter().all(|b| a != b), "key {i} is not new");
        }
        let mut others = simplify();
        others.candidates.source = false;
        assert_eq!(keys[0], of(&others));
    }

    #[test]
    fn later_parameters_are_in_no_key_of_shapes() {
        let key = |settings: &BakeSettings| {
            let params = Params::new(settings);
            let Params { candidates, collapse, .. } = params;
            let simplify = SimplifyParams { budgets: settings.faces.clone(), candidates, collapse };
            shapes_key(&some_key("1"), &simplify, &params)
        };
        let base = BakeSettings::default();
        for later in [
            BakeSettings { texture_size: 64.into(), ..base.clone() },
            BakeSettings { gutter: 2, ..base.clone() },
            BakeSettings { normal_map: false, ..base.clone() },
            BakeSettings { texture_format: TextureFormat::Jpeg(90), ..base.clone() },
            BakeSettings { refine_steps: 1, ..base.clone() },
            BakeSettings { coarse_views: 1, ..base.clone() },
        ] {
            assert_eq!(key(&later), key(&base), "{later:?}");
        }
        for own in [
            BakeSettings { faces: vec![9], ..base.clone() },
            BakeSettings { views: 8, ..base.clone() },
            BakeSettings { watertight: true, ..base.clone() },
            BakeSettings { painted_importance: 2.0, ..base.clone() },
            BakeSettings { joint_delta: 0.2, ..base.clone() },
        ] {
            assert_ne!(key(&own), key(&base), "{own:?}");
        }
    }

    #[test]
    fn only_parameters_of_the_maps_and_the_file_are_in_no_key_of_vertices() {
        let key = |settings: &BakeSettings| {
            vertices_key(&some_key("1"), &Params::new(settings).level(1000, LevelView::default()), 1000, false)
        };
        let base = BakeSettings::default();
        assert_eq!(key(&BakeSettings { normal_map: false, ..base.clone() }), key(&base));
        assert_eq!(key(&BakeSettings { source: SourceGeometry::Drop, ..base.clone() }), key(&base));
        assert_eq!(key(&BakeSettings { texture_format: TextureFormat::Jpeg(90), ..base.clone() }), key(&base));
        for own in [
            BakeSettings { gutter: 2, ..base.clone() },
            BakeSettings { texture_smoothness: 0.5, ..base.clone() },
            BakeSettings { coarse_views: 1, ..base.clone() },
            BakeSettings { bone_faces: 1.0, ..base.clone() },
        ] {
            assert_ne!(key(&own), key(&base), "{own:?}");
        }
        let level = Params::new(&base).level(1000, LevelView::default());
        assert_ne!(vertices_key(&some_key("1"), &level, 2000, false), key(&base));
        assert_ne!(vertices_key(&some_key("1"), &level, 1000, true), key(&base));
    }

    const GLTF: &[u8] = br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"a.bin","byteLength":4}]}"#;

    struct OneFile(&'static [u8]);

    impl Resources for OneFile {
        fn read(&self, uri: &RelativeUri) -> Result<bytes::Bytes, String> {
            if uri.as_str() == "a.bin" { Ok(bytes::Bytes::from_static(self.0)) } else { Err("none".into()) }
        }
    }

    #[test]
    fn the_key_of_a_bake_follows_external_files_and_settings_but_no_name() {
        let key = |name: &str, resources: &dyn Resources, settings: &BakeSettings| {
            bake_key(&Source { name, bytes: GLTF, resources }, settings).expect("a glTF")
        };
        let settings = BakeSettings::default();
        let base = key("a.gltf", &OneFile(b"1234"), &settings);
        assert_eq!(base, key("elsewhere/b.gltf", &OneFile(b"1234"), &settings));
        assert_ne!(base, key("a.gltf", &OneFile(b"1235"), &settings));
        assert_ne!(base, key("a.gltf", &NoResources, &settings));
        let changed = BakeSettings { gutter: 2, ..settings.clone() };
        assert_ne!(base, key("a.gltf", &OneFile(b"1234"), &changed));
        // What divides a file into objects counts only where it is divided.
        let few = BakeSettings { object_faces: 9, ..settings.clone() };
        assert_eq!(base, key("a.gltf", &OneFile(b"1234"), &few));
        let divided = BakeSettings { scope: Scope::Objects, ..settings };
        let few = BakeSettings { scope: Scope::Objects, ..few };
        let [divided, few] = [divided, few].map(|settings| key("a.gltf", &OneFile(b"1234"), &settings));
        assert!(divided != base && few != divided);
        let with_whole = BakeSettings { scope: Scope::Objects, whole: Budgets(vec![9]), ..BakeSettings::default() };
        assert_ne!(divided, key("a.gltf", &OneFile(b"1234"), &with_whole));
        let shared_atlas = AtlasSize::Texels(64);
        let with_atlas = BakeSettings { scope: Scope::Objects, shared_atlas, ..BakeSettings::default() };
        assert_ne!(divided, key("a.gltf", &OneFile(b"1234"), &with_atlas));
    }

    #[test]
    fn a_quality_counts_by_its_values() {
        use crate::settings::Quality;
        let best = BakeSettings::preset(Quality::Best);
        let BakeSettings { finest_resolution, poses, texture_size, views, refine_steps, .. } = best.clone();
        let draft = BakeSettings::preset(Quality::Draft);
        let spelled = BakeSettings { finest_resolution, poses, texture_size, views, refine_steps, ..draft };
        assert_eq!(Params::new(&best), Params::new(&spelled));
    }

    /// Fails when the encoding changes, or when a version is raised: then these become the new ones.
    #[test]
    fn the_encoding_is_stable() {
        let mesh = TriMesh { positions: vec![Vec3::X, Vec3::Y, Vec3::Z], triangles: vec![[0, 1, 2]] };
        let candidate = Candidate::Reconstruction(Reconstruction::new(128));
        let keys = [
            candidate_key(&some_key("1"), &simplify(), candidate),
            atlas_key(&mesh, &[], &UnwrapParams { size: 512, gutter: 4 }),
        ];
        assert_eq!(
            (PIPELINE_VERSION, keys.map(|key| key.hex()[..16].to_owned())),
            ("31", ["4497770c46c9bbfc", "dff6066c9ae59e8c"].map(str::to_owned))
        );
    }
}
