//! Sources and detailed levels that a game loads on demand: the processed file of a model gets the smallest levels alone, and
//! the source and each other level become files of their own in a folder beside the processed files. Their names are those of
//! their content, so a model always finds the parts that belong to it, whichever of the files is replaced first.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use bevy::asset::AssetPath;
use bevy::asset::io::AssetSourceId;
use bevy::prelude::*;
use simpliguard::gltf::{DividedPart, divide};
use simpliguard::settings::{BakeSettings, SourceGeometry};
use simpliguard_cache::{Durability, write_atomic_through};

use super::journal::Journal;

/// The processed file of a model with levels: the whole, or the smallest levels alone with the other parts beside it. Where it
/// cannot be divided, it stays whole.
pub(super) fn processed_file(
    journal: &Journal,
    path: &AssetPath<'static>,
    settings: &BakeSettings,
    whole: Vec<u8>,
) -> Vec<u8> {
    let folder = journal.source_folder(path);
    if settings.source != SourceGeometry::OnDemand || *path.source() != AssetSourceId::Default {
        return whole;
    }
    match divide(&path.to_string(), &whole) {
        Ok(Some(divided)) => match place(journal, &folder, &divided.parts) {
            Ok(()) => return divided.levels,
            Err(error) => warn!("{path}: its source is always loaded, because {} failed: {error}", folder.display()),
        },
        Ok(None) => debug!("{path}: nothing of it can be loaded on demand"),
        Err(error) => warn!("{path}: its source is always loaded: {error}"),
    }
    whole
}

/// Writes the files of parts, unless they are there.
fn place(journal: &Journal, folder: &Path, parts: &[DividedPart]) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    for DividedPart { name, bytes } in parts {
        let file = folder.join(name);
        if !file.exists() {
            write_atomic_through(&journal.scratch()?, &file, bytes, Durability::Process)?;
        }
    }
    remove_old(folder, parts)
}

/// Removes the files of other versions of a model, but for those of the last one: the game may still have the levels that belong
/// to it.
fn remove_old(folder: &Path, parts: &[DividedPart]) -> io::Result<()> {
    let mut others: Vec<(SystemTime, PathBuf)> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let is_current = parts.iter().any(|part| entry.file_name().to_str() == Some(&part.name));
        if !is_current && entry.file_type()?.is_file() {
            others.push((entry.metadata()?.modified()?, entry.path()));
        }
    }
    let Some(last) = others.iter().max().map(|(_, file)| version(file)) else { return Ok(()) };
    others.iter().filter(|(_, file)| version(file) != last).try_for_each(|(_, old)| fs::remove_file(old))
}

/// The beginning of a file's name, which the files of one version have in common.
fn version(file: &Path) -> Option<String> {
    let name = file.file_name()?.to_str()?;
    Some(name.split(['_', '.']).next()?.to_owned())
}

/// Removes the files of models that are gone.
pub(super) fn remove_stale(journal: &Journal) -> io::Result<()> {
    let root = journal.sources();
    let mut open = vec![root.clone()];
    while let Some(folder) = open.pop() {
        let entries = match fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            entries => entries?.collect::<io::Result<Vec<_>>>()?,
        };
        for entry in entries {
            let path = entry.path();
            let model = path.strip_prefix(&root).map(|path| journal.processed_file(&AssetPath::from(path.to_owned())));
            if !entry.file_type()?.is_dir() || model.as_ref().is_ok_and(|model| model.is_file()) {
                continue;
            }
            match model.is_ok_and(|folder| folder.is_dir()) {
                true => open.push(path),
                false => fs::remove_dir_all(path)?,
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn journal() -> (tempfile::TempDir, Journal) {
        let dir = tempfile::tempdir().expect("tempdir");
        let journal = Journal::new(dir.path().join("imported_assets/Default"));
        (dir, journal)
    }

    fn parts(names: &[&str]) -> Vec<DividedPart> {
        names.iter().map(|name| DividedPart { name: (*name).into(), bytes: b"part".to_vec() }).collect()
    }

    #[test]
    fn the_last_parts_of_a_model_stay_until_the_next_but_one() {
        let (_dir, journal) = journal();
        let folder = journal.source_folder(&"models/a.glb".into());
        let versions = [["1.glb", "1_LOD2.glb"], ["2.glb", "2_LOD2.glb"], ["3.glb", "3_LOD2.glb"]];
        for (i, names) in versions.iter().enumerate() {
            place(&journal, &folder, &parts(names)).expect("writes");
            for (j, name) in names.iter().enumerate() {
                let time = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs((2 * i + j) as u64);
                let file = fs::File::options().write(true).open(folder.join(name)).expect("opens");
                file.set_modified(time).expect("sets");
            }
        }
        let there = versions.map(|names| names.map(|name| folder.join(name).exists()));
        assert_eq!(there, [[false; 2], [true; 2], [true; 2]]);
    }

    #[test]
    fn sources_go_with_their_models() {
        let (_dir, journal) = journal();
        remove_stale(&journal).expect("there is no folder");
        let paths = ["models/a.glb", "models/b.glb", "gone/c.glb"].map(AssetPath::from);
        for path in &paths {
            place(&journal, &journal.source_folder(path), &parts(&["1.glb"])).expect("writes");
        }
        let processed = journal.processed_file(&paths[0]);
        fs::create_dir_all(processed.parent().expect("a folder")).expect("writes");
        fs::write(processed, "levels").expect("writes");
        remove_stale(&journal).expect("removes");
        assert_eq!(paths.each_ref().map(|path| journal.source_folder(path).exists()), [true, false, false]);
        assert!(!journal.sources().join("gone").exists());
    }

    #[test]
    fn a_file_that_cannot_be_divided_stays_whole() {
        let (_dir, journal) = journal();
        let on_demand = BakeSettings { source: SourceGeometry::OnDemand, ..BakeSettings::default() };
        let whole = b"no glTF".to_vec();
        assert_eq!(processed_file(&journal, &"a.glb".into(), &on_demand, whole.clone()), whole);
        assert!(!journal.sources().exists());
    }
}
