//! Changes to files, passed on at the right time. Changes to a source are passed on once, and not while the processor
//! is at work on the file. Changes to a processed model are passed on only if the game has not seen them.

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

use super::activity::ProcessorActivity;
use super::names::is_model;
use super::timing::{PATIENCE, QUIET, TICK};

type Sender = async_channel::Sender<AssetSourceEvent>;
type Receiver = async_channel::Receiver<AssetSourceEvent>;

/// Passes on changes below the source folder `folder`, in a thread that ends with the watcher.
pub(super) fn pass_on_settled(folder: &str, changes: Receiver, out: Sender, activity: Arc<ProcessorActivity>) {
    let root = FileAssetReader::get_base_path().join(folder);
    let started = thread::Builder::new().name("simpliguard watch".into()).spawn(move || {
        let mut pending = PendingChanges::new(root);
        while let Some(change) = pending.next(&changes) {
            let mut events: Vec<AssetSourceEvent> =
                change.and_then(|c| pending.add(c, Instant::now())).into_iter().collect();
            events.extend(pending.settled(Instant::now(), &activity));
            for event in events {
                if out.send_blocking(event).is_err() {
                    return;
                }
            }
        }
    });
    if let Err(error) = started {
        warn!("changes to assets are not seen: {error}");
    }
}

/// Passes on changes to processed files, except changes to models that the game has read since.
pub(super) fn pass_on_news(folder: &str, changes: Receiver, out: Sender, activity: Arc<ProcessorActivity>) {
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

/// Changed files that were not passed on yet.
struct PendingChanges {
    root: PathBuf,
    files: BTreeMap<PathBuf, Change>,
}

struct Change {
    first: Instant,
    last: Instant,
    /// The path was removed, and may have been a folder.
    unknown: bool,
}

impl PendingChanges {
    fn new(root: PathBuf) -> Self {
        Self { root, files: BTreeMap::new() }
    }

    /// Waits for the next change. `Some(None)` if it is time to check the pending changes, `None` if the watcher has
    /// ended.
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

    /// Adds a change. Returns an event that has to be passed on at once.
    fn add(&mut self, change: AssetSourceEvent, now: Instant) -> Option<AssetSourceEvent> {
        match change {
            AssetSourceEvent::AddedAsset(path)
            | AssetSourceEvent::ModifiedAsset(path)
            | AssetSourceEvent::RemovedAsset(path)
            | AssetSourceEvent::AddedMeta(path)
            | AssetSourceEvent::ModifiedMeta(path)
            | AssetSourceEvent::RemovedMeta(path)
            | AssetSourceEvent::RemovedUnknown { path, is_meta: true } => self.file(path, now, false),
            AssetSourceEvent::RemovedUnknown { path, is_meta: false } => self.file(path, now, true),
            // For a rename, Bevy renames the processed file too. An editor that renames a new version into the place of
            // the old one would get the processed file of the new version's former name.
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

    /// Adds all files below a folder: a new folder comes without changes to its files.
    fn files_below(&mut self, folder: &Path, now: Instant) {
        let root = self.root.clone();
        for entry in WalkDir::new(root.join(folder)).follow_links(true).into_iter().filter_map(Result::ok) {
            if let (true, Ok(path)) = (entry.file_type().is_file(), entry.path().strip_prefix(&root)) {
                let is_meta = path.extension().is_some_and(|e| e == "meta");
                self.file(if is_meta { path.with_extension("") } else { path.to_owned() }, now, false);
            }
        }
    }

    /// The events to pass on now. They describe the files as they are, whatever happened to them meanwhile.
    fn settled(&mut self, now: Instant, activity: &ProcessorActivity) -> Vec<AssetSourceEvent> {
        let is_settled = |path: &Path, change: &Change| {
            (now >= change.last + QUIET || now >= change.first + PATIENCE) && activity.is_free(path, now)
        };
        let settled = self.files.extract_if(.., |path, change| is_settled(path, change)).collect::<Vec<_>>();
        settled.into_iter().flat_map(|(path, change)| self.state_of(path, change, now)).collect()
    }

    /// The event that describes a file as it is now.
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

    /// A folder without pending changes and without activity, and the time.
    fn nothing_pending(dir: &tempfile::TempDir) -> (PendingChanges, Arc<ProcessorActivity>, Instant) {
        (PendingChanges::new(dir.path().to_owned()), Arc::default(), Instant::now())
    }

    #[test]
    fn many_changes_of_a_file_are_one() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut pending, activity, start) = nothing_pending(&dir);
        for i in 0..10 {
            let now = start + QUIET / 2 * i;
            let added = if i == 0 { AssetSourceEvent::AddedMeta } else { AssetSourceEvent::ModifiedAsset };
            assert_eq!(pending.add(added(asset("a.glb")), now), None);
            assert_eq!(pending.settled(now, &activity), []);
        }
        let end = start + QUIET * 6;
        assert_eq!(pending.settled(end, &activity), [AssetSourceEvent::ModifiedAsset(asset("a.glb"))]);
        assert_eq!(pending.settled(end + PATIENCE, &activity), []);
    }

    #[test]
    fn a_file_that_never_rests_is_told_at_last() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut pending, activity, start) = nothing_pending(&dir);
        pending.add(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start);
        pending.add(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start + PATIENCE);
        assert_eq!(pending.settled(start + PATIENCE, &activity).len(), 1);
    }

    #[test]
    fn a_change_waits_for_the_processor() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("a.glb"), "1").expect("writes");
        let (mut pending, activity, start) = nothing_pending(&dir);
        pending.add(AssetSourceEvent::ModifiedAsset(asset("a.glb")), start);
        let path = asset("a.glb");
        let processing = activity.processing(&path);
        assert_eq!(pending.settled(start + QUIET, &activity), []);
        assert_eq!(pending.settled(start + PATIENCE, &activity), []);
        drop(processing);
        assert_eq!(pending.settled(start + QUIET, &activity).len(), 1);
    }

    #[test]
    fn a_rename_is_a_file_that_is_gone_and_one_that_changed() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::create_dir(dir.path().join("new")).expect("makes");
        for name in ["a.glb", "new/b.glb", "new/b.glb.meta"] {
            fs::write(dir.path().join(name), "1").expect("writes");
        }
        let (mut pending, activity, start) = nothing_pending(&dir);
        pending.add(AssetSourceEvent::RenamedAsset { old: asset("a.tmp"), new: asset("a.glb") }, start);
        pending.add(AssetSourceEvent::RemovedUnknown { path: asset("other"), is_meta: false }, start);
        let folders = AssetSourceEvent::RenamedFolder { old: asset("old"), new: asset("new") };
        assert_eq!(pending.add(folders, start), Some(AssetSourceEvent::RemovedFolder(asset("old"))));
        let told = pending.settled(start + QUIET, &activity);
        let wanted = [
            AssetSourceEvent::ModifiedAsset(asset("a.glb")),
            AssetSourceEvent::RemovedAsset(asset("a.tmp")),
            AssetSourceEvent::ModifiedAsset(asset("new/b.glb")),
            AssetSourceEvent::RemovedUnknown { path: asset("other"), is_meta: false },
        ];
        assert_eq!(told, wanted);
    }
}
