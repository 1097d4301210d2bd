//! Each kernel against the CPU.

use glam::{Vec3, Vec4};
use simpliguard::Cancellation;
use simpliguard::refine::{
    BATCH, Backend, CoveredViews, Cpu, Drawing, LeastSquares, LevelRenderer, LossTerms, LowPoly, Refined, Solver,
    TextureFit, ViewGradient, fit_texture,
};
use simpliguard::render::View;
use simpliguard_gpu::{Choice, Gpu};

use crate::scene::{ball, pair, soup, views};
use crate::{found, gpu};

/// A view at rest, and one in a pose.
const VIEWS: [usize; BATCH] = [1, 2];

fn scenes() -> [(&'static str, LowPoly); 3] {
    [("coarse ball", ball(5)), ("fine ball", ball(24)), ("soup", soup(600))]
}

/// The results of `work` on the GPU and on the CPU.
fn on_both<T>(gpu: &Gpu, low: &LowPoly, views: &[View], work: impl Fn(&mut dyn AnyRenderer) -> T) -> (T, T) {
    on_both_with(gpu, low, &CoveredViews::new(views.iter().collect()), work)
}

fn on_both_with<T>(
    gpu: &Gpu,
    low: &LowPoly,
    views: &CoveredViews<'_>,
    work: impl Fn(&mut dyn AnyRenderer) -> T,
) -> (T, T) {
    let cancellation = Cancellation::default();
    let mut on_gpu = gpu.open(low, views.clone(), &cancellation).expect("opens");
    let Ok(mut on_cpu) = Cpu.open(low, views.clone(), &cancellation);
    (work(&mut on_gpu), work(&mut on_cpu))
}

/// A renderer that must not fail.
trait AnyRenderer {
    fn draw(&mut self, low: &LowPoly, view: usize) -> Drawing;
    fn differentiate(&mut self, low: &LowPoly, terms: LossTerms) -> [ViewGradient; BATCH];
    fn errors(&mut self, low: &LowPoly) -> Vec<f64>;
    fn solved(&mut self, low: &LowPoly, stride: usize) -> Vec<Vec4>;
}

impl<E: std::fmt::Debug> AnyRenderer for Box<dyn LevelRenderer<Error = E> + '_> {
    fn draw(&mut self, low: &LowPoly, view: usize) -> Drawing {
        self.as_mut().draw(low, view).expect("draws")
    }

    fn differentiate(&mut self, low: &LowPoly, terms: LossTerms) -> [ViewGradient; BATCH] {
        let mut gradients = Default::default();
        self.as_mut().differentiate(low, VIEWS, terms, &mut gradients).expect("differentiates");
        gradients
    }

    fn errors(&mut self, low: &LowPoly) -> Vec<f64> {
        self.as_mut().errors(low).expect("scores")
    }

    fn solved(&mut self, low: &LowPoly, stride: usize) -> Vec<Vec4> {
        let mut low = low.clone();
        self.as_mut().solve_texture(&mut low, LeastSquares::new(stride, 0.1)).expect("solves");
        low.texture.texels
    }
}

#[test]
fn visibility_and_colours_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (name, low) in scenes() {
        let views = views(&pair(&low), 4);
        for view in 0..views.len() {
            let (found, expected) = on_both(gpu, &low, &views, |renderer| renderer.draw(&low, view));
            let covered = expected.ids.iter().filter(|id| **id != u32::MAX).count();
            assert!(covered > 5000, "{name}: {covered}");
            let other = expected.ids.iter().zip(&found.ids).filter(|(a, b)| a != b).count();
            assert!(other * 1000 <= covered, "{name}, view {view}: {other} of {covered} pixels show another triangle");
            let apart = |(a, b): (&Vec4, &Vec4)| (*a - *b).abs().max_element();
            let differences = expected.colors.iter().zip(&found.colors).map(apart);
            // A pixel that shows another triangle changes itself and its neighbours.
            let wrong = differences.filter(|difference| *difference > 1e-4).count();
            assert!(wrong <= 5 * other, "{name}, view {view}: {wrong} colours differ, with {other} other triangles");
        }
    }
}

fn cosine(a: &[Vec3], b: &[Vec3]) -> f64 {
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| f64::from(a.dot(*b))).sum::<f64>();
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
}

#[test]
fn losses_and_gradients_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (name, low) in scenes() {
        let views = views(&pair(&low), 4);
        for terms in
            [LossTerms { background: 0.0, gradient_weight: 0.0 }, LossTerms { background: 1.0, gradient_weight: 0.5 }]
        {
            let (found, expected) = on_both(gpu, &low, &views, |renderer| renderer.differentiate(&low, terms));
            for (found, expected) in found.iter().zip(&expected) {
                let apart = (found.loss - expected.loss).abs() / expected.loss;
                assert!(apart < 1e-5, "{name}, {terms:?}: losses {} and {}", found.loss, expected.loss);
                for (found, expected) in [(&found.posed, &expected.posed), (&found.positions, &expected.positions)] {
                    let cosine = cosine(found, expected);
                    assert!(cosine > 0.9999, "{name}, {terms:?}: cosine {cosine}");
                    let ratio = cosine * norm(found) / norm(expected);
                    assert!((ratio - 1.0).abs() < 1e-3, "{name}, {terms:?}: ratio {ratio}");
                }
            }
        }
    }
}

fn norm(vectors: &[Vec3]) -> f64 {
    vectors.iter().map(|v| f64::from(v.length_squared())).sum::<f64>().sqrt()
}

/// Views as they are, and as if they were not antialiased.
fn both_kinds(views: &[View]) -> [CoveredViews<'_>; 2] {
    [CoveredViews::new, CoveredViews::aliased].map(|kind| kind(views.iter().collect()))
}

#[test]
fn scores_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (name, low) in scenes() {
        for views in both_kinds(&views(&pair(&low), 5)) {
            let (found, expected) = on_both_with(gpu, &low, &views, |renderer| renderer.errors(&low));
            assert_eq!(found.len(), 5);
            for (found, expected) in found.iter().zip(&expected) {
                let apart = (found - expected).abs() / expected;
                assert!(apart < 1e-5, "{name}, aliased: {}: {found} and {expected}", views.aliased);
            }
        }
    }
}

/// Largest difference of a channel.
fn apart(a: &[Vec4], b: &[Vec4]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max)
}

#[test]
fn the_texture_is_that_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (name, low) in scenes() {
        let source = pair(&low);
        let views = views(&source, 12);
        // The level has the vertices of the source: then its texture can be found.
        let low = LowPoly { positions: source.positions.clone(), ..low };
        for views in both_kinds(&views) {
            for stride in [1, 5] {
                let (found, expected) = on_both_with(gpu, &low, &views, |renderer| renderer.solved(&low, stride));
                let (change, error) = (apart(&expected, &low.texture.texels), apart(&expected, &found));
                let case = format!("{name}, stride {stride}, aliased: {}", views.aliased);
                assert!(change > 0.05, "{case}: {change}");
                assert!(error < 2e-3, "{case}: texels differ by {error}, of a change of {change}");
            }
        }
    }
}

fn fitted<E: std::fmt::Debug>(
    backend: &dyn Backend<Error = E>,
    low: &LowPoly,
    views: &[View],
    trust: f32,
) -> (Vec<Vec4>, Refined) {
    let fit = TextureFit { smoothness: 0.1, trust: Some(trust), solver: Solver::LeastSquares };
    let mut low = low.clone();
    let refined = fit_texture(&mut low, views, Some(&fit), backend, &Cancellation::default()).expect("fits");
    (low.texture.texels, refined)
}

#[test]
fn the_final_texture_is_that_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (name, low) in scenes() {
        let source = pair(&low);
        let views = views(&source, 12);
        let low = LowPoly { positions: source.positions.clone(), ..low };
        for trust in [0.02, 0.3] {
            let (found, expected) = (fitted(gpu, &low, &views, trust), fitted(&Cpu, &low, &views, trust));
            let (change, error) = (apart(&expected.0, &low.texture.texels), apart(&expected.0, &found.0));
            assert!(change > 0.05, "{name}, trust {trust}: {change}");
            assert!(error < 2e-3, "{name}, trust {trust}: texels differ by {error}, of a change of {change}");
            for psnr in [|r: &Refined| r.psnr_initial, |r: &Refined| r.psnr] {
                let (found, expected) = (psnr(&found.1), psnr(&expected.1));
                assert!((found - expected).abs() < 0.01, "{name}, trust {trust}: {found} and {expected} dB");
            }
        }
    }
}

#[test]
fn equal_runs_give_equal_bytes() {
    let Some(gpu) = gpu() else { return };
    let (low, terms) = (soup(600), LossTerms { background: 1.0, gradient_weight: 0.5 });
    let views = views(&pair(&low), 6);
    let run = || {
        on_both(gpu, &low, &views, |renderer| {
            (renderer.differentiate(&low, terms), renderer.errors(&low), renderer.solved(&low, 1))
        })
        .0
    };
    let first = run();
    for _ in 0..3 {
        assert!(run() == first);
    }
}

#[test]
fn a_renderer_follows_the_level() {
    let Some(gpu) = gpu() else { return };
    let (low, terms) = (ball(12), LossTerms { background: 1.0, gradient_weight: 0.5 });
    let views = views(&pair(&low), 4);
    let mut moved = low.clone();
    moved.positions.iter_mut().for_each(|p| *p *= 0.9);
    moved.texture.texels.iter_mut().for_each(|texel| *texel = (*texel * 0.5).with_w(1.0));
    let (after, fresh) = (
        on_both(gpu, &low, &views, |renderer| {
            renderer.differentiate(&low, terms);
            renderer.solved(&low, 1);
            renderer.differentiate(&moved, terms)
        }),
        on_both(gpu, &low, &views, |renderer| renderer.differentiate(&moved, terms)),
    );
    assert!(after == fresh);
}

#[test]
fn a_lost_device_is_an_error_at_every_point() {
    let low = ball(8);
    let views = views(&pair(&low), 4);
    let (cancellation, terms) = (Cancellation::default(), LossTerms { background: 1.0, gradient_weight: 0.5 });
    for submissions in (0..20).step_by(3) {
        let Some(gpu) = found(Gpu::open(Choice::AlsoSoftware)) else { return };
        gpu.lose_after(submissions);
        let run = || {
            let mut low = low.clone();
            let mut renderer = gpu.open(&low, CoveredViews::new(views.iter().collect()), &cancellation)?;
            let renderer = renderer.as_mut();
            renderer.differentiate(&low, VIEWS, terms, &mut Default::default())?;
            renderer.errors(&low)?;
            renderer.solve_texture(&mut low, LeastSquares::new(1, 0.1))
        };
        let error = run().expect_err("the device is lost").to_string();
        assert!(error.starts_with("the device "), "{submissions}: {error}");
        assert!(run().is_err(), "it stays lost");
    }
}
