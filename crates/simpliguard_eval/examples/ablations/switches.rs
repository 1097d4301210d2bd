//! One part of the pipeline after the other is switched off, or an optional one on.

use std::error::Error;

use simpliguard::data::Model;
use simpliguard::render::Light;
use simpliguard::settings::{BakeSettings, Candidates, InitialTexture, TextureSolver};
use simpliguard_eval::{Similarity, side_by_side, similarity};

use crate::baking::Bakery;
use crate::{Arguments, say};

/// A row: its name, and the settings that make it.
type Switch = (&'static str, fn(BakeSettings) -> BakeSettings);

const SWITCHES: [Switch; 14] = [
    ("all parts", |s| s),
    ("without reconstruction", |s| BakeSettings { candidates: Candidates::Source, ..s }),
    ("without removal of invisible faces", |s| BakeSettings { remove_invisible: false, ..s }),
    ("without texture initialisation", |s| BakeSettings { initial_texture: InitialTexture::Grey, ..s }),
    ("without differentiable rendering", |s| BakeSettings { refine: false, ..s }),
    ("without vertex steps", |s| BakeSettings { refine_steps: 0, ..s }),
    ("without image gradient loss", |s| BakeSettings { gradient_weight: 0.0, ..s }),
    ("120 steps, all at full size", |s| BakeSettings { refine_steps: 120, coarse_steps: 0.0, ..s }),
    ("without texture smoothness loss", |s| BakeSettings { texture_smoothness: 0.0, ..s }),
    ("without distance to the source", |s| BakeSettings { distance_weight: 0.0, ..s }),
    ("without Laplacian", |s| BakeSettings { laplacian_weight: 0.0, ..s }),
    ("with normal consistency 0.001", |s| BakeSettings { normal_weight: 0.001, ..s }),
    ("with curvature quadric 0.1", |s| BakeSettings { curvature: 0.1, ..s }),
    ("texture by Adam", |s| BakeSettings { texture_solver: TextureSolver::Adam, ..s }),
];

/// How one level of one row looks.
#[derive(Clone, Copy, Default)]
struct Look {
    unlit: Similarity,
    lit: Similarity,
    /// dB over the views that its own bake held out.
    held_out: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let wanted = |(name, _): &&Switch| arguments.only.as_ref().is_none_or(|text| name.contains(text.as_str()));
    let switches: Vec<&Switch> = SWITCHES.iter().filter(wanted).collect();
    header("model");
    let mut all: Vec<Vec<Vec<Look>>> = Vec::new();
    for file in &arguments.files {
        let bakery = Bakery::open(file)?;
        let mut drawn: Vec<Model> = Vec::new();
        let mut looks = Vec::new();
        for (name, switched) in &switches {
            let made = bakery.bake(&switched(arguments.settings.clone()), true)?;
            let model = made.model()?;
            if drawn.is_empty() {
                drawn.push(model.clone());
            }
            let mut of_row = Vec::new();
            for (level, report) in made.baked.levels.iter().zip(&made.baked.report.levels) {
                let own = level.to_model(name);
                let [unlit, lit] = [Light::None, Light::Head].map(|l| similarity(model, &own, arguments.views, l));
                let held_out = report.refined.map_or(f64::NAN, |r| f64::from(r.psnr));
                let look = Look { unlit, lit, held_out };
                row(&bakery.name, name, report.faces, &look);
                of_row.push(look);
            }
            drawn.extend(made.baked.levels.first().map(|level| level.to_model(name)));
            looks.push(of_row);
        }
        all.push(looks);
        if let Some(folder) = &arguments.pictures {
            std::fs::create_dir_all(folder)?;
            let models: Vec<&Model> = drawn.iter().collect();
            side_by_side(&models).save(folder.join(format!("{}_ablations.png", bakery.name)))?;
        }
    }
    if arguments.files.len() > 1 {
        means(&switches, &arguments.settings.faces, &all);
    }
    Ok(())
}

fn header(first: &str) {
    say(&format!("| {first} | | faces | PSNR, dB | foreground | SSIM | PSNR lit, dB | held out, dB |"));
    say("|---|---|---|---|---|---|---|---|");
}

fn row(model: &str, switch: &str, faces: u32, look: &Look) {
    let Look { unlit, lit, held_out } = look;
    say(&format!(
        "| {model} | {switch} | {faces} | {:.2} | {:.2} | {:.4} | {:.2} | {held_out:.2} |",
        unlit.psnr, unlit.psnr_foreground, unlit.ssim, lit.psnr
    ));
}

/// Over the models that have a level.
fn means(switches: &[&Switch], faces: &[u32], all: &[Vec<Vec<Look>>]) {
    header("mean");
    for (s, (name, _)) in switches.iter().enumerate() {
        for (l, &budget) in faces.iter().enumerate() {
            let looks: Vec<Look> = all.iter().filter_map(|looks| looks[s].get(l)).copied().collect();
            let mean = |of: fn(&Look) -> f64| looks.iter().map(of).sum::<f64>() / looks.len().max(1) as f64;
            let similarity = |of: fn(&Look) -> Similarity| Similarity {
                psnr: looks.iter().map(|l| of(l).psnr).sum::<f64>() / looks.len().max(1) as f64,
                psnr_foreground: looks.iter().map(|l| of(l).psnr_foreground).sum::<f64>() / looks.len().max(1) as f64,
                ssim: looks.iter().map(|l| of(l).ssim).sum::<f64>() / looks.len().max(1) as f64,
            };
            let look =
                Look { unlit: similarity(|l| l.unlit), lit: similarity(|l| l.lit), held_out: mean(|l| l.held_out) };
            row(&format!("{} models", looks.len()), name, budget, &look);
        }
    }
}
