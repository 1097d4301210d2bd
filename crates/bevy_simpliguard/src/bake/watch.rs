//! Changes to files, told when they are to be heard: those of sources once each and not while the processor is busy with
//! the file, those of processed models only if the game has not seen them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Instant;

use bevy::asset::io::AssetSourceEvent;
use bevy::asset::io::file::FileAssetReader;
use bevy::prelude::*;
use bevy::tasks::IoTaskPool;
use walkdir::WalkDir;

use super::activity::Activity;
use super::names::is_model;
use super::readers::{PATIENCE, QUIET, TICK};

type Sender = async_channel::Sender<AssetSourceEvent>;
type Receiver = async_channel::Receiver<AssetSourceEvent>;

/// Passes on changes below the source folder `folder`, in a thread that ends with the watcher.
pub(super) fn tell_when_calm(folder: &str, changes: Receiver, out: Sender, activity: Arc<Activity>) {
    let root = FileAssetReader::get_base_path().join(folder);
    let told = thread::Builder::new().name("simpliguard watch".into()).spawn(move || {
        let mut unrest = Unrest::new(root);
        while let Some(change) = unrest.next(&changes) {
            let mut tell: Vec<AssetSourceEvent> =
                change.and_then(|c| unrest.note(c, Instant::now())).into_iter().collect();
            tell.extend(unrest.calm(Instant::now(), &activity));
            for event in tell {
                if out.send_blocking(event).is_err() {
                    return;
                }
            }
        }
    });
    if let Err(error) = told {
        warn!("changes to assets are not seen: {error}");
    }
}

/// Passes on changes to processed files, except those to models that the game has read since.
pub(super) fn tell_news(folder: &str, changes: Receiver, out: Sender, activity: Arc<Activity>) {
    let root = FileAssetReader::get_base_path().join(folder);
    let pass = async move {
        while let Ok(change) = changes.recv().await {
            let is_news = match &change {
                AssetSourceEvent::AddedAsset(path)
                | AssetSourceEvent::ModifiedAsset(path)
                | AssetSourceEvent::ModifiedMeta(path)
                    if is_model(path) =>
                {
                    activity.is_news(path, &root.join(path))
                }
                _ => true,
            };
            if is_news && out.send(change).await.is_err() {
                return;
            }
        }
    };
    IoTaskPool::get().spawn(pass).detach();
}

/// Files that have changed and are not told yet.
struct Unrest {
    root: PathBuf,
    files: BTreeMap<PathBuf, Change>,
}

struct Change {
    first: Instant,
    last: Instant,
    /// What is gone may have been a folder.
    unknown: bool,
}

impl Unrest {
    fn new(root: PathBuf) -> Self {
        Self { root, files: BTreeMap::new() }
    }

    /// Waits for the next change: `Some(None)` if it is time to look at what waits, `None` if there will be none.
    fn next(&self, changes: &Receiver) -> Option<Option<AssetSourceEvent>> {
        if self.files.is_empty() {
            return changes.recv_blocking().ok().map(Some);
        }
        match changes.try_recv() {
            Ok(change) => Some(Some(change)),
            Err(error) if error.is_closed() => None,
            Err(_) => {
                thread::sleep(TICK);
                Some(None)
            }
        }
    }

    /// Takes a change in. Returns what is to be told at once.
    fn note(&mut self, change: AssetSourceEvent, now: Instant) -> Option<AssetSourceEvent> {
        match change {
            AssetSourceEvent::AddedAsset(path)
            | AssetSourceEvent::ModifiedAsset(path)
            | AssetSourceEvent::RemovedAsset(path)
            | AssetSourceEvent::AddedMeta(path)
            | AssetSourceEvent::ModifiedMeta(path)
            | AssetSourceEvent::RemovedMeta(path)
            | AssetSourceEvent::RemovedUnknown { path, is_meta: true } => self.file(path, now, false),
            AssetSourceEvent::RemovedUnknown { path, is_meta: false } => self.file(path, now, true),
            // Bevy takes the processed file along, and an editor that renames a new version into the place of the old
            // one would get that of the new version's former name.
            AssetSourceEvent::RenamedAsset { old, new } | AssetSourceEvent::RenamedMeta { old, new } => {
                self.file(old, now, false);
                self.file(new, now, false);
            }
            AssetSourceEvent::AddedFolder(folder) => self.files_below(&folder, now),
            AssetSourceEvent::RenamedFolder { old, new } => {
                self.files_below(&new, now);
                return (old != new).then_some(AssetSourceEvent::RemovedFolder(old));
            }
            AssetSourceEvent::RemovedFolder(folder) => return Some(AssetSourceEvent::RemovedFolder(folder)),
        }
        None
    }

    fn file(&mut self, path: PathBuf, now: Instant, unknown: bool) {
        let change = self.files.entry(path).or_insert(Change { first: now, last: now, unknown });
        change.last = now;
        change.unknown &= unknown;
    }

    /// A folder that came as a whole is not followed by changes to what it holds.
    fn files_below(&mut self, folder: &Path, now: Instant) {
        let root = self.root.clone();
        for entry in WalkDir::new(root.join(folder)).follow_links(true).into_iter().filter_map(Result::ok) {
            if let (true, Ok(path)) = (entry.file_type().is_file(), entry.path().strip_prefix(&root)) {
                let is_meta = path.extension().is_some_and(|e| e == "meta");
                self.file(if is_meta { path.with_extension("") } else { path.to_owned() }, now, false);
            }
        }
    }

    /// What is to be told now: the files as they are, whatever happened to them meanwhile.
    fn calm(&mut self, now: Instant, activity: &Activity) -> Vec<AssetSourceEvent> {
        let is_calm = |path: &Path, change: &Change| {
            (now >= change.last + QUIET || now >= change.first + PATIENCE) && activity.is_free(path, now)
        };
        let calm = self.files.extract_if(.., |path, change| is_calm(path, change)).collect::<Vec<_>>();
        calm.into_iter().flat_map(|(path, change)| self.state_of(path, change, now)).collect()
    }

    fn state_of(&mut self, path: PathBuf, change: Change, now: Instant) -> Option<AssetSourceEvent> {
        let file = self.root.join(&path);
        if file.is_dir() {
            self.files_below(&path, now);
            return None;
        }
        Some(match (file.exists(), change.unknown) {
            (true, _) => AssetSourceEvent::ModifiedAsset(path),
            (false, false) => AssetSourceEvent::RemovedAsset(path),
            (false, true) => AssetSourceEvent::RemovedUnknown { path, is_meta: false },
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn asset(path: &str) -> PathBuf {
        PathBuf::from(path)
    }

    #[test]
    fn many_changes_of_a_file_are_one() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut unrest, activity, start) = (Unrest::new(dir.path().to_owned()), Activity::default(), Instant::now());
        for i in 0..10 {
            let now = start + QUIET / 2 * i;
            let added = if i == 0 { AssetSourceEvent::AddedMeta } else { AssetSourceEvent::ModifiedAsset };
            assert_eq!(unrest.note(added(asset("a.glb")), now), None);
            assert_eq!(unrest.calm(now, &activity), []);
        }
        let end = start + QUIET * 6;
        assert_eq!(unrest.calm(end, &activity), [AssetSourceEvent::ModifiedAsset(asset("a.glb"))]);
        assert_eq!(unrest.calm(end + PATIENCE, &activity), []);
    }

    #[test]
    fn a_file_that_never_rests_is_told_at_last() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut unrest, activity, start) = (Unrest::new(dir.path().to_owned()), Activity::default(), Instant::now());
        unrest.note(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start);
        unrest.note(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start + PATIENCE);
        assert_eq!(unrest.calm(start + PATIENCE, &activity).len(), 1);
    }

    #[test]
    fn a_change_waits_for_the_processor() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut unrest, activity, start) = (Unrest::new(dir.path().to_owned()), Activity::default(), Instant::now());
        unrest.note(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start);
        let path = asset("a.glb");
        let processing = activity.processing(&path);
        assert_eq!(unrest.calm(start + QUIET, &activity), []);
        assert_eq!(unrest.calm(start + PATIENCE, &activity), []);
        drop(processing);
        assert_eq!(unrest.calm(start + QUIET, &activity).len(), 1);
    }

    #[test]
    fn a_rename_is_a_file_that_is_gone_and_one_that_changed() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::create_dir(dir.path().join("new")).expect("makes");
        for name in ["a.glb", "new/b.glb", "new/b.glb.meta"] {
            fs::write(dir.path().join(name), "1").expect("writes");
        }
        let (mut unrest, activity, start) = (Unrest::new(dir.path().to_owned()), Activity::default(), Instant::now());
        unrest.note(AssetSourceEvent::RenamedAsset { old: asset("a.tmp"), new: asset("a.glb") }, start);
        unrest.note(AssetSourceEvent::RemovedUnknown { path: asset("other"), is_meta: false }, start);
        let folders = AssetSourceEvent::RenamedFolder { old: asset("old"), new: asset("new") };
        assert_eq!(unrest.note(folders, start), Some(AssetSourceEvent::RemovedFolder(asset("old"))));
        let told = unrest.calm(start + QUIET, &activity);
        let wanted = [
            AssetSourceEvent::ModifiedAsset(asset("a.glb")),
            AssetSourceEvent::RemovedAsset(asset("a.tmp")),
            AssetSourceEvent::ModifiedAsset(asset("new/b.glb")),
            AssetSourceEvent::RemovedUnknown { path: asset("other"), is_meta: false },
        ];
        assert_eq!(told, wanted);
    }
}
