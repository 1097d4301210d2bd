//! The corpora of the fuzz targets, without a fuzzer.

use std::fs;
use std::path::Path;

use simpliguard_fuzz::TARGETS;

#[test]
fn every_body_returns_for_every_input_of_its_corpus() {
    let corpora = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/corpus");
    for (name, body) in TARGETS {
        body(&[]);
        let mut files: Vec<_> = fs::read_dir(corpora.join(name)).expect(name).map(|e| e.expect(name).path()).collect();
        files.sort();
        assert!(files.len() >= 10, "{name} has {} inputs", files.len());
        files.iter().for_each(|file| body(&fs::read(file).expect(name)));
    }
}
