//! The asset processor.

use std::sync::Arc;

use bevy::asset::AsyncWriteExt;
use bevy::asset::io::Writer;
use bevy::asset::processor::{Process, ProcessContext, ProcessError};
use bevy::gltf::{GltfLoader, GltfLoaderSettings};
use bevy::prelude::*;
use serde::de::{Deserialize, Deserializer, IgnoredAny};
use serde::{Serialize, Serializer};

use super::baker::Baker;
use super::input::{Input, InputLoader};

/// Processes `.glb` and `.gltf` files: writes what the cache has, else the model as it is, and has it baked. Named
/// `bevy_simpliguard::SimpliguardProcess` in `.meta` files.
#[derive(TypePath)]
#[type_path = "bevy_simpliguard"]
pub struct SimpliguardProcess {
    pub(super) baker: Arc<Baker>,
}

/// The settings of a `.meta` file, unread: a mistake in them must not keep the model out of the game, as an error would
/// here. They are read with the chain's own parser, which says where the mistake is.
#[derive(Clone, Copy, Debug, Default)]
pub struct MetaSettings;

impl<'de> Deserialize<'de> for MetaSettings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(deserializer).map(|_| Self)
    }
}

impl Serialize for MetaSettings {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_unit()
    }
}

impl Process for SimpliguardProcess {
    type Settings = MetaSettings;
    type OutputLoader = GltfLoader;

    /// Never bakes, and fails only if the output cannot be written: Bevy would drop all it has processed otherwise, and
    /// a second change during a long run would stop it for good.
    async fn process(
        &self,
        context: &mut ProcessContext<'_>,
        _: &MetaSettings,
        writer: &mut Writer,
    ) -> Result<GltfLoaderSettings, ProcessError> {
        let path = context.path().clone();
        let file = path.path().to_owned();
        let _processing = self.baker.activity.processing(&file);
        let loaded = context.load_source_asset::<InputLoader>(&()).await?;
        let input = loaded.take::<Input>().expect("the loader makes nothing else");
        let output = self.baker.output_for(&path, input).await;
        writer.write_all(&output).await.map_err(|e| ProcessError::AssetWriterError { path, err: e.into() })?;
        Ok(GltfLoaderSettings::default())
    }
}

#[cfg(test)]
mod tests {
    use bevy::asset::meta::AssetMeta;

    use super::*;

    #[test]
    fn any_settings_are_taken_and_the_processor_has_the_documented_name() {
        assert_eq!(SimpliguardProcess::type_path(), "bevy_simpliguard::SimpliguardProcess");
        for settings in
            ["()", "(faces: [1, 2], quality: Draft)", "(resolution: Cells(64), what: [(a: 1)])", "(fces: -1.5)"]
        {
            let meta = format!(
                "(meta_format_version: \"1.0\", asset: Process(processor: \"bevy_simpliguard::SimpliguardProcess\", \
                 settings: {settings}))"
            );
            AssetMeta::<(), SimpliguardProcess>::deserialize(meta.as_bytes()).expect(settings);
        }
    }
}
