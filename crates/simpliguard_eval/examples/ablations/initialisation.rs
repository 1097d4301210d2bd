//! What the initial texture saves where descent fits it: quality over time from a baked texture and from a grey one, on
//! vertices that stay where they are.

use std::error::Error;

use simpliguard::settings::{BakeSettings, InitialTexture, TextureSolver};

use crate::baking::Bakery;
use crate::{Arguments, say};

/// Steps of the descents compared; each is run from its beginning.
const STEPS: [u32; 9] = [0, 5, 10, 20, 40, 80, 160, 320, 640];

/// Where a descent of some length ends.
struct Point {
    steps: u32,
    seconds: f64,
    psnr: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    for file in &arguments.files {
        let bakery = Bakery::open(file)?;
        let base = BakeSettings {
            refine_steps: 0,
            texture_solver: TextureSolver::Adam,
            faces: arguments.settings.faces.first().copied().into_iter().collect(),
            ..arguments.settings.clone()
        };
        // Warms what all of them share, and times what is no descent.
        let unfitted = |initial_texture| BakeSettings { initial_texture, texture_steps: 0, ..base.clone() };
        bakery.bake(&unfitted(InitialTexture::Baked), true)?;
        let still = bakery.bake(&unfitted(InitialTexture::Grey), true)?.stage("refine");
        let curve = |initial_texture| -> Result<Vec<Point>, Box<dyn Error>> {
            let point = |steps: u32| {
                let settings = BakeSettings { initial_texture, texture_steps: steps, ..base.clone() };
                let made = bakery.bake(&settings, true)?;
                let baking = if initial_texture == InitialTexture::Baked { made.stage("texture") } else { 0.0 };
                let psnr = made.baked.report.levels[0].refined.ok_or("a cut-out is not fitted")?.psnr;
                let seconds = (made.stage("refine") - still).max(0.0) + baking;
                Ok(Point { steps, seconds, psnr: f64::from(psnr) })
            };
            STEPS.iter().map(|&steps| point(steps)).collect()
        };
        let (baked, grey) = (curve(InitialTexture::Baked)?, curve(InitialTexture::Grey)?);
        say(&format!(
            "| {}: steps | baked, s | PSNR, dB | grey, s | PSNR, dB | seconds from grey to the PSNR of baked |",
            bakery.name
        ));
        say("|---|---|---|---|---|---|");
        for (b, g) in baked.iter().zip(&grey) {
            let reached = seconds_to(b.psnr, &grey).map_or("never".to_owned(), |s| format!("{s:.2}"));
            say(&format!(
                "| {} | {:.2} | {:.2} | {:.2} | {:.2} | {reached} |",
                b.steps, b.seconds, b.psnr, g.seconds, g.psnr
            ));
        }
        let solved = BakeSettings { texture_solver: TextureSolver::LeastSquares, ..base.clone() };
        let solved = bakery.bake(&solved, true)?;
        let psnr = solved.baked.report.levels[0].refined.ok_or("a cut-out is not fitted")?.psnr;
        let seconds = solved.stage("refine") - still + solved.stage("texture");
        say(&format!("| least squares | {seconds:.2} | {psnr:.2} | | | |"));
    }
    Ok(())
}

/// When a curve reaches `psnr`, between its points by straight lines.
fn seconds_to(psnr: f64, curve: &[Point]) -> Option<f64> {
    let after = curve.iter().position(|point| point.psnr >= psnr)?;
    let Some(before) = after.checked_sub(1).map(|i| &curve[i]) else { return Some(curve[after].seconds) };
    let part = (psnr - before.psnr) / (curve[after].psnr - before.psnr);
    Some(before.seconds + part * (curve[after].seconds - before.seconds))
}
