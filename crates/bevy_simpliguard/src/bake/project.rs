//! The asset source `simpliguard://`. It has one file, made of the project's settings, the chosen profile and the
//! version of the pipeline. Every baked model has this file as a process dependency. So Bevy processes all models again
//! when one of the three changes.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bevy::asset::AssetPath;
use bevy::asset::io::file::FileAssetReader;
use bevy::asset::io::{AssetReader, AssetReaderError, AssetSource, AssetSourceBuilder, PathStream, Reader, VecReader};
use simpliguard::PIPELINE_VERSION;
use simpliguard::settings::ProjectFile;

/// The id of the asset source.
pub(super) const SOURCE: &str = "simpliguard";
/// Folder of the processor's copy, relative to the base of all asset folders.
const PROCESSED: &str = "imported_assets/.simpliguard/project";
/// Time for an editor to write a file.
const SETTLE: std::time::Duration = std::time::Duration::from_millis(300);

/// The project's settings file, and the chosen profile.
#[derive(Clone, Debug)]
pub(super) struct Project {
    /// The base of all asset folders, which holds `config/`.
    pub(super) base: PathBuf,
    /// The chosen profile.
    pub(super) profile: Option<String>,
}

impl Project {
    pub(super) fn new(profile: Option<String>) -> Self {
        Self { base: FileAssetReader::get_base_path(), profile }
    }

    /// The one file of the source.
    pub(super) fn asset() -> AssetPath<'static> {
        AssetPath::from(PathBuf::from(file_name())).with_source(SOURCE)
    }

    /// The asset source. Without `process`, its processed file cannot be written.
    pub(super) fn source(&self, process: bool) -> AssetSourceBuilder {
        let project = self.clone();
        let folder = Path::new(ProjectFile::PATH).parent().unwrap_or(Path::new("")).to_string_lossy().into_owned();
        let builder = AssetSourceBuilder::new(move || Box::new(ProjectReader(Arc::new(project.clone()))))
            .with_processed_reader(AssetSource::get_default_reader(PROCESSED.to_owned()));
        if !process {
            return builder;
        }
        let builder = builder.with_processed_writer(AssetSource::get_default_writer(PROCESSED.to_owned()));
        if self.base.join(&folder).is_dir() {
            builder.with_watcher(AssetSource::get_default_watcher(folder, SETTLE))
        } else {
            builder
        }
    }

    /// The project's file as it is on disk.
    pub(super) fn read(&self) -> Result<ProjectFile, simpliguard::Error> {
        let text = self.text().map_err(|e| simpliguard::Error::Settings(format!("{}: {e}", ProjectFile::PATH)))?;
        ProjectFile::parse(&text, ProjectFile::PATH)
    }

    /// The project file in the bytes of the source's file, behind the first line.
    pub(super) fn parse(&self, asset: &[u8]) -> Result<ProjectFile, simpliguard::Error> {
        let text = String::from_utf8_lossy(asset);
        ProjectFile::parse(text.split_once('\n').map_or("", |(_, text)| text), ProjectFile::PATH)
    }

    /// The text of the project's file; that of an empty file if there is none.
    fn text(&self) -> io::Result<String> {
        match std::fs::read_to_string(self.base.join(ProjectFile::PATH)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok("()".to_owned()),
            read => read,
        }
    }

    /// The bytes of the source's file.
    fn content(&self) -> io::Result<Vec<u8>> {
        let profile = self.profile.as_deref().unwrap_or_default();
        Ok(format!("// simpliguard {PIPELINE_VERSION}, profile '{profile}'\n{}", self.text()?).into_bytes())
    }
}

fn file_name() -> &'static str {
    Path::new(ProjectFile::PATH).file_name().and_then(|name| name.to_str()).unwrap_or(ProjectFile::PATH)
}

struct ProjectReader(Arc<Project>);

impl AssetReader for ProjectReader {
    async fn read<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        if path != Path::new(file_name()) {
            return Err(AssetReaderError::NotFound(path.to_owned()));
        }
        Ok(VecReader::new(self.0.content()?))
    }

    async fn read_meta<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        Err::<VecReader, _>(AssetReaderError::NotFound(path.to_owned()))
    }

    async fn read_directory<'a>(&'a self, _: &'a Path) -> Result<Box<PathStream>, AssetReaderError> {
        Ok(Box::new(OneFile(Some(PathBuf::from(file_name())))))
    }

    async fn is_directory<'a>(&'a self, path: &'a Path) -> Result<bool, AssetReaderError> {
        Ok(path == Path::new(""))
    }
}

/// The listing of the source's folder.
struct OneFile(Option<PathBuf>);

impl bevy::tasks::futures_lite::Stream for OneFile {
    type Item = PathBuf;

    fn poll_next(
        mut self: std::pin::Pin<&mut Self>,
        _: &mut std::task::Context<'_>,
    ) -> std::task::Poll<Option<PathBuf>> {
        std::task::Poll::Ready(self.0.take())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_tells_version_profile_and_settings_apart() {
        let dir = tempfile::tempdir().expect("tempdir");
        let project =
            |profile: Option<&str>| Project { base: dir.path().to_owned(), profile: profile.map(str::to_owned) };
        let content = |profile| project(profile).content().expect("reads");
        let none = content(None);
        assert!(project(None).parse(&none).is_ok());
        assert_ne!(none, content(Some("vr")));
        assert!(String::from_utf8_lossy(&none).contains(PIPELINE_VERSION));
        std::fs::create_dir(dir.path().join("config")).expect("makes");
        std::fs::write(dir.path().join(ProjectFile::PATH), "(\n defaults: (gutter: 2, fces: []))").expect("writes");
        assert_ne!(none, content(None));
        let error = project(None).parse(&content(None)).expect_err("unknown field").to_string();
        assert!(error.starts_with("settings: config/simpliguard.ron:2:24: unknown field 'fces'"), "{error}");
        assert_eq!(project(None).read().expect_err("unknown field").to_string(), error);
    }
}
