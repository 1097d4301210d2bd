//! What the initial texture saves where descent fits it: quality over time from a baked texture and from a grey one, on
//! vertices that stay where they are.

use std::error::Error;
use std::path::Path;

use simpliguard::settings::{BakeSettings, InitialTexture, LevelMaterials, TextureSolver};

use crate::baking::Bakery;
use crate::{Arguments, chart, say};

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
            materials: LevelMaterials::Baked,
            faces: arguments.settings.faces.first().copied().into_iter().collect(),
            ..arguments.settings.clone()
        };
        let race = Race::new(&bakery, base)?;
        let (baked, grey) = (race.curve(InitialTexture::Baked)?, race.curve(InitialTexture::Grey)?);
        table(&bakery.name, &baked, &grey);
        let Point { seconds, psnr, .. } = race.solved()?;
        say(&format!("| least squares | {seconds:.2} | {psnr:.2} | | | |"));
        if let Some(folder) = &arguments.pictures {
            std::fs::create_dir_all(folder)?;
            draw(&folder.join(format!("{}_figure_9.svg", bakery.name)), &baked, &grey)?;
        }
    }
    Ok(())
}

/// Descents on one model.
struct Race<'a> {
    bakery: &'a Bakery,
    base: BakeSettings,
    /// Seconds of the last stage without a descent. Where vertices stay, the texture is fitted there.
    still: f64,
    /// Seconds that it takes to bake the texture.
    baking: f64,
}

impl<'a> Race<'a> {
    fn new(bakery: &'a Bakery, base: BakeSettings) -> Result<Self, Box<dyn Error>> {
        // Warms what all of them share. A texture is a stage of its own where vertices move.
        let moved = BakeSettings { refine_steps: 1, texture_steps: 0, ..base.clone() };
        let baking = bakery.bake(&moved, true)?.stage("texture");
        let unfitted = BakeSettings { initial_texture: InitialTexture::Grey, texture_steps: 0, ..base.clone() };
        let still = bakery.bake(&unfitted, true)?.stage("maps");
        Ok(Self { bakery, base, still, baking })
    }

    /// Where descents of all lengths end that begin with a texture.
    fn curve(&self, initial_texture: InitialTexture) -> Result<Vec<Point>, Box<dyn Error>> {
        let settings = |steps| BakeSettings { initial_texture, texture_steps: steps, ..self.base.clone() };
        let is_baked = initial_texture == InitialTexture::Baked;
        STEPS.iter().map(|&steps| self.point(steps, &settings(steps), is_baked)).collect()
    }

    /// Where least squares end.
    fn solved(&self) -> Result<Point, Box<dyn Error>> {
        let settings = BakeSettings { texture_solver: TextureSolver::LeastSquares, ..self.base.clone() };
        self.point(0, &settings, true)
    }

    fn point(&self, steps: u32, settings: &BakeSettings, is_baked: bool) -> Result<Point, Box<dyn Error>> {
        let made = self.bakery.bake(settings, true)?;
        let baking = if is_baked { self.baking } else { 0.0 };
        let refined = made.baked.report.levels[0].refined.ok_or("a cut-out is not fitted")?;
        let seconds = (made.stage("maps") - self.still).max(0.0) + baking;
        Ok(Point { steps, seconds, psnr: f64::from(refined.psnr) })
    }
}

fn table(name: &str, baked: &[Point], grey: &[Point]) {
    say(&format!(
        "| {name}: steps | baked, s | PSNR, dB | grey, s | PSNR, dB | seconds from grey to the PSNR of baked |"
    ));
    say("|---|---|---|---|---|---|");
    for (b, g) in baked.iter().zip(grey) {
        let reached = seconds_to(b.psnr, grey).map_or("never".to_owned(), |s| format!("{s:.2}"));
        say(&format!(
            "| {} | {:.2} | {:.2} | {:.2} | {:.2} | {reached} |",
            b.steps, b.seconds, b.psnr, g.seconds, g.psnr
        ));
    }
}

/// The paper's figure: quality over time.
fn draw(file: &Path, baked: &[Point], grey: &[Point]) -> Result<(), Box<dyn Error>> {
    let points = |curve: &[Point]| curve.iter().map(|point| (point.seconds, point.psnr)).collect();
    let lines = [("from a baked texture", points(baked)), ("from a grey one", points(grey))];
    chart::lines(file, ["seconds", "PSNR, dB"], &lines)
}

/// When a curve reaches `psnr`, between its points by straight lines.
fn seconds_to(psnr: f64, curve: &[Point]) -> Option<f64> {
    let after = curve.iter().position(|point| point.psnr >= psnr)?;
    let Some(before) = after.checked_sub(1).map(|i| &curve[i]) else { return Some(curve[after].seconds) };
    let part = (psnr - before.psnr) / (curve[after].psnr - before.psnr);
    Some(before.seconds + part * (curve[after].seconds - before.seconds))
}
