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

/// Processes `.glb` and `.gltf` files. Writes the levels if the cache has them, otherwise the model as it is, and
/// queues a bake. Its name in `.meta` files is `bevy_simpliguard::SimpliguardProcess`.
#[derive(TypePath)]
#[type_path = "bevy_simpliguard"]
pub struct SimpliguardProcess {
    pub(super) baker: Arc<Baker>,
}

/// The settings of a `.meta` file, unread. An error here would keep the model out of the game. So they are read later,
/// with the parser of `simpliguard`, which also reports the position of a mistake.
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

    /// Writes the processed file. Does not bake itself: a second change during a long run would stop Bevy's processor
    /// for ever. Fails only if the model cannot be read or the output cannot be written: after errors, Bevy drops all
    /// processed files.
    async fn process(
        &self,
        context: &mut ProcessContext<'_>,
        _: &MetaSettings,
        writer: &mut Writer,
    ) -> Result<GltfLoaderSettings, ProcessError> {
        let path = context.path().clone();
        let file = path.path().to_owned();
        let _processing = self.baker.activity.processing(&file);
        // From here on no swap begins. The last one ends before the desired levels change.
        self.baker.activity.swap_ended(&file).await;
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
