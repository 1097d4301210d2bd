//! How time and likeness depend on the size of the source: bakes of one generated shape from 10,000 to a million
//! triangles.

use std::error::Error;

use simpliguard::render::Light;
use simpliguard::settings::{BakeSettings, LevelMaterials};
use simpliguard::{STAGES, StageId};
use simpliguard_eval::similarity;

use crate::baking::Bakery;
use crate::{Arguments, chart, say, sphere};

const FACES: [usize; 5] = [10_000, 30_000, 100_000, 300_000, 1_000_000];
/// Index of the size whose stages are drawn: the paper's 30,000 triangles.
const DRAWN: usize = 1;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    // The model has no skeleton.
    let timed = |id: &StageId| *id != StageId::Skinning;
    let stages: Vec<String> = STAGES.iter().map(|s| s.id).filter(timed).map(|id| id.to_string()).collect();
    say(&format!("| triangles | {}, s | whole bake, s | PSNR, dB |", stages.join(", s | ")));
    say(&format!("|{}", "---|".repeat(stages.len() + 3)));
    let (mut likeness, mut bars) = (Vec::new(), Vec::new());
    for faces in FACES {
        let bakery = Bakery::new("sphere", sphere::glb(faces)?);
        let budget = arguments.settings.faces.first().copied().unwrap_or(1000);
        let settings =
            BakeSettings { faces: vec![budget], materials: LevelMaterials::Baked, ..arguments.settings.clone() };
        let made = bakery.bake(&settings, false)?;
        let model = made.model()?;
        let level = made.baked.levels[0].to_model(model);
        let psnr = similarity(model, &level, arguments.views, Light::None).psnr;
        let seconds: Vec<f64> = stages.iter().map(|stage| made.stage(stage)).collect();
        let times: Vec<String> = seconds.iter().map(|time| format!("{time:.2}")).collect();
        let count = model.surface.triangles.len();
        say(&format!("| {count} | {} | {:.2} | {psnr:.2} |", times.join(" | "), made.seconds));
        likeness.push((made.seconds, psnr));
        bars.push(stages.iter().cloned().zip(seconds).collect::<Vec<_>>());
    }
    if let Some(folder) = &arguments.pictures {
        std::fs::create_dir_all(folder)?;
        chart::bars(&folder.join("figure_7_stages.svg"), "s", &bars[DRAWN])?;
        let line = ("from 10,000 to a million triangles", likeness);
        chart::lines(&folder.join("figure_7_psnr.svg"), ["seconds", "PSNR, dB"], &[line])?;
    }
    Ok(())
}
