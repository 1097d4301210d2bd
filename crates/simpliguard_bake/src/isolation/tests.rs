//! A parent with children that serve, crash and hang. The children are this test program, which runs one of its tests.

use std::cell::RefCell;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use std::{process, thread};

use simpliguard::data::{Level, Model};
use simpliguard::settings::{BackendChoice, BakeSettings, Quality};
use simpliguard::{Cancellation, Context, Error, NoResources, RelativeUri, Resources, Source, Status};

use super::messages::Message;
use super::request::{self, Request, Terms, Wanted};
use super::{Isolation, is_child, serve};
use crate::cached::{CachedBake, Outcome};
use crate::device::Processor;
use crate::host::{Host, Notice};
use crate::result::Parts;

/// A glTF without triangles, which passes through.
const EMPTY: &[u8] = br#"{"asset":{"version":"2.0"}}"#;

#[test]
fn child_that_serves() {
    if is_child() {
        serve(&|_: &Model, _: &[Level]| Ok(Vec::new()), || {});
    }
}

#[test]
fn child_that_crashes() {
    if is_child() {
        Message::Ready.send().expect("a parent");
        process::abort();
    }
}

#[test]
fn child_that_hangs() {
    if is_child() {
        Message::Ready.send().expect("a parent");
        thread::sleep(Duration::from_secs(600));
    }
}

/// This program, which runs one test.
fn child(test: &str) -> Isolation {
    let program = process_path();
    Isolation::of(program, &[&format!("isolation::tests::{test}"), "--exact", "--nocapture"])
}

fn process_path() -> PathBuf {
    std::env::current_exe().expect("the test program")
}

#[derive(Default)]
struct Recorder(RefCell<Vec<String>>);

impl Host for Recorder {
    fn notify(&self, notice: Notice) {
        assert!(notice.is_warning());
        self.0.borrow_mut().push(notice.to_string());
    }
}

fn bake(bytes: &[u8], isolation: &Isolation, context: &Context<'_>) -> (Result<Outcome, Error>, Vec<String>) {
    let (settings, host) = (BakeSettings::default(), Recorder::default());
    let source = Source { name: "model.gltf", bytes, resources: &NoResources };
    let bake = CachedBake::new(source, &settings, Parts::Levels, None).map(|bake| bake.isolated(Some(isolation)));
    (bake.and_then(|bake| bake.run(context, &host)), host.0.into_inner())
}

#[test]
fn a_child_bakes_as_its_parent_does() {
    let (outcome, notices) = bake(EMPTY, &child("child_that_serves"), &Context::default());
    let result = outcome.expect("is baked").result;
    let settings = BakeSettings::default();
    let source = Source { name: "model.gltf", bytes: EMPTY, resources: &NoResources };
    let own = CachedBake::new(source, &settings, Parts::Levels, None).expect("a glTF");
    let own = own.run(&Context::default(), &Recorder::default()).expect("is baked").result;
    assert_eq!((result.combined, result.levels, result.sheet), (own.combined, own.levels, own.sheet));
    assert_eq!((result.report.status, result.report.notes), (Status::PassThrough, own.report.notes));
    assert!(notices.is_empty(), "{notices:?}");
}

#[test]
fn errors_of_a_child_are_those_of_a_bake() {
    let indices = br#"{"asset":{"version":"2.0"},"extensionsRequired":["EXT_unheard_of"],"nodes":[]}"#;
    let (outcome, _) = bake(indices, &child("child_that_serves"), &Context::default());
    assert!(matches!(outcome, Err(Error::Extension { extension, .. }) if extension == "EXT_unheard_of"));
}

#[test]
fn a_crash_costs_the_model_alone() {
    let (outcome, _) = bake(EMPTY, &child("child_that_crashes"), &Context::default());
    let error = outcome.expect_err("the child is gone").to_string();
    assert!(error.starts_with("model.gltf: import: the process of the bake ended ("), "{error}");
}

#[test]
fn a_bake_that_hangs_is_cancelled_at_once() {
    let cancellation = Cancellation::default();
    let context = Context { cancellation: cancellation.clone(), ..Context::default() };
    let start = Instant::now();
    let outcome = thread::scope(|scope| {
        scope.spawn(|| {
            thread::sleep(Duration::from_millis(500));
            cancellation.cancel();
        });
        bake(EMPTY, &child("child_that_hangs"), &context).0
    });
    assert!(matches!(outcome, Err(Error::Cancelled { .. })), "{outcome:?}");
    assert!(start.elapsed() < Duration::from_secs(300), "the child was waited for");
}

#[test]
fn without_a_child_the_parent_bakes() {
    // One that is not there, and one that ends without serving.
    for isolation in [Isolation::of("no such program".into(), &[]), child("no_such_test")] {
        let (outcome, notices) = bake(EMPTY, &isolation, &Context::default());
        assert_eq!(outcome.expect("is baked").result.report.status, Status::PassThrough);
        assert_eq!(notices.len(), 1);
        assert!(notices[0].starts_with("it is baked in this process, because "), "{notices:?}");
    }
}

/// The files of a model: one that is there, and one that is not.
struct Beside;

impl Resources for Beside {
    fn read(&self, uri: &RelativeUri) -> Result<bytes::Bytes, String> {
        if uri.as_str() == "a b%.bin" { Ok(vec![1, 2, 3].into()) } else { Err("it is not there".into()) }
    }
}

#[test]
fn a_request_arrives_as_it_was_sent() {
    let model = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":3,"uri":"a%20b%25.bin"},{"byteLength":1,"uri":"c.bin"}]}"#;
    let source = Source { name: "a.gltf", bytes: model, resources: &Beside };
    let settings = BakeSettings { faces: vec![70, 90], ..BakeSettings::preset(Quality::Draft) };
    let folder = PathBuf::from("folder");
    let processor = Processor { backend: BackendChoice::Gpu, work_in_a_frame: Some(Duration::from_micros(2500)) };
    let terms =
        Terms { wanted: Wanted::Sheet, preview: true, memory: Some(5), processor, threads: 3, folder: folder.clone() };
    let mut bytes = Vec::new();
    request::write(&mut bytes, &source, &settings, None, terms).expect("is written");

    let request = Request::read(&mut &*bytes).expect("is whole");
    assert_eq!((request.source().name, request.source().bytes), ("a.gltf", &model[..]));
    let read = |uri: &str| request.source().resources.read(&RelativeUri::parse(uri).expect("valid"));
    assert_eq!(read("a%20b%25.bin").as_deref(), Ok(&[1, 2, 3][..]));
    assert_eq!(read("c.bin"), Err("it is not there".into()));
    assert!(read("d.bin").is_err() && request.cache().is_none());
    assert_eq!((&request.settings, request.header.memory, request.header.threads), (&settings, Some(5), 3));
    assert!(request.header.wanted == Wanted::Sheet && request.header.preview && request.header.folder == folder);
    assert_eq!(request.header.processor, processor);
    for end in [0, 10, bytes.len() - 1] {
        assert!(Request::read(&mut &bytes[..end]).is_err(), "{end} bytes were enough");
    }
}
