//! Whole bakes on the device, and on one that fails.

use simpliguard::refine::{Backend, Device};
use simpliguard::settings::{BakeOverrides, BakeSettings, Layer, Origin, resolve};
use simpliguard::{Baked, Context, NoResources, Source, bake};
use simpliguard_gpu::{Choice, Gpu};

use crate::found;

const MODEL: &[u8] = include_bytes!("../../../../assets/octopus.glb");

/// Two levels, few steps: some at half resolution, some at full.
const SETTINGS: [(&str, &str); 8] = [
    ("quality", "draft"),
    ("faces", "600,1200"),
    ("refine_steps", "30"),
    ("coarse_steps", "0.5"),
    ("coarse_views", "8"),
    ("views", "12"),
    ("view_size", "128"),
    ("texture_size", "128"),
];

fn settings() -> BakeSettings {
    let mut overrides = BakeOverrides::default();
    SETTINGS.iter().for_each(|(name, value)| overrides.set(name, value).expect(name));
    resolve(vec![Layer { origin: Origin::CommandLine, overrides }]).expect("valid").settings
}

fn baked(device: Option<&Device>) -> Baked {
    let source = Source { name: "octopus", bytes: MODEL, resources: &NoResources };
    bake(&source, &settings(), &Context { device, ..Context::default() }).expect("bakes")
}

/// PSNR to the source of each level, without and with light, and the gain of the refinement.
fn figures(baked: &Baked) -> Vec<[f32; 3]> {
    let figures = |level: &simpliguard::LevelReport| {
        let likeness = level.likeness.as_ref().expect("compared");
        [likeness.psnr, likeness.psnr_lit, level.refined.expect("refined").psnr]
    };
    baked.report.levels.iter().map(figures).collect()
}

#[test]
fn a_bake_on_the_device_looks_like_one_on_the_cpu() {
    let Some(gpu) = found(Gpu::open(Choice::AlsoSoftware)) else { return };
    let (on_gpu, on_cpu) = (baked(Some(&gpu)), baked(None));
    assert!(on_gpu.report.levels.iter().all(|level| level.device.as_deref() == Some(gpu.name())));
    assert!(on_cpu.report.levels.iter().all(|level| level.device.is_none()));
    assert_eq!(on_gpu.report.notes, on_cpu.report.notes);
    assert_alike(&on_gpu, &on_cpu);
    // The last work of a bake is the final texture of one of its levels, and the score of that.
    let at_the_end = found(Gpu::open(Choice::AlsoSoftware)).expect("opens again");
    at_the_end.lose_after(gpu.submissions() - 4);
    let after = baked(Some(&at_the_end));
    assert_eq!(warnings(&after), 1, "{:?}", after.report.notes);
    assert_alike(&after, &on_cpu);
    assert!(after.glb != on_gpu.glb, "one texture is that of the CPU");
    assert!(on_gpu.glb == baked(Some(&gpu)).glb, "two runs give equal bytes");
}

fn assert_alike(on_gpu: &Baked, on_cpu: &Baked) {
    let (found, expected) = (figures(on_gpu), figures(on_cpu));
    assert_eq!((found.len(), expected.len()), (2, 2));
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 0.1, "{found} dB on the GPU, {expected} dB on the CPU");
    }
}

/// Number of notes that the device failed.
fn warnings(baked: &Baked) -> usize {
    baked.report.notes.iter().filter(|note| note.contains("levels are refined on the CPU instead")).count()
}

#[test]
fn a_bake_goes_on_without_a_device_that_is_lost() {
    let expected = baked(None);
    // At the first texture, in the steps at half resolution, and in those at full resolution.
    for submissions in [0, 40, 150] {
        let Some(gpu) = found(Gpu::open(Choice::AlsoSoftware)) else { return };
        gpu.lose_after(submissions);
        let after = baked(Some(&gpu));
        assert_eq!(warnings(&after), 1, "{:?}", after.report.notes);
        let lost = after.report.levels.iter().filter(|level| level.device.is_none()).count();
        assert!(lost > 0, "after {submissions}");
        if lost == after.report.levels.len() {
            assert!(after.glb == expected.glb, "after {submissions}");
        }
    }
}
