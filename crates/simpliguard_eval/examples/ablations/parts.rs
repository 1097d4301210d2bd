//! What each part is worth: the levels of every row beside those of all parts.

use std::error::Error;

use simpliguard::data::{Level, Model};
use simpliguard::gltf::{ImportLimits, export_level, import};
use simpliguard::render::Light;
use simpliguard::{NoResources, Source};
use simpliguard_eval::compare::{Options, compare};
use simpliguard_eval::{side_by_side, similarity};

use crate::baking::Bakery;
use crate::switches::{ALL, SWITCHES, Switch};
use crate::{Arguments, say};

/// How one level of one row looks.
#[derive(Clone, Copy, Default)]
struct Look {
    psnr: f64,
    ssim: f64,
    lit: f64,
    /// PSNR over the frames of the clips; `None` if they were not asked for.
    moving: Option<f64>,
}

/// The looks of a model: by row, then by level.
struct Measured {
    name: String,
    rows: Vec<Vec<Look>>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let wanted = |row: &&Switch| arguments.only.iter().any(|text| row.label().contains(text.as_str()));
    let rows = SWITCHES.iter().filter(|row| arguments.only.is_empty() || wanted(row));
    let rows: Vec<&Switch> = std::iter::once(&ALL).chain(rows).collect();
    say("| model | | triangles | PSNR, dB | SSIM | PSNR lit, dB | moving, dB | seconds |");
    say("|---|---|---|---|---|---|---|---|");
    let mut all = Vec::new();
    for file in &arguments.files {
        let bakery = Bakery::open(file)?;
        match measure(&bakery, &rows, arguments) {
            Ok(measured) => all.push(measured),
            // The others count.
            Err(error) => say(&format!("<!-- {}: {error} -->", file.display())),
        }
    }
    summary(&rows, &arguments.settings.faces, &all);
    Ok(())
}

/// Bakes a model once for each row.
fn measure(bakery: &Bakery, rows: &[&Switch], arguments: &Arguments) -> Result<Measured, Box<dyn Error>> {
    let (mut drawn, mut looks): (Vec<Model>, _) = (Vec::new(), Vec::new());
    for row in rows {
        let made = bakery.bake(&(row.set)(arguments.settings.clone()), true)?;
        let model = made.model()?;
        if drawn.is_empty() {
            drawn.push(model.clone());
        }
        let levels = made.baked.levels.iter();
        let of_row = levels.map(|level| look(model, level, arguments)).collect::<Result<Vec<Look>, _>>()?;
        for (look, level) in of_row.iter().zip(&made.baked.report.levels) {
            let moving = look.moving.map_or_else(|| "-".to_owned(), |psnr| format!("{psnr:.2}"));
            say(&format!(
                "| {} | {} | {} | {:.2} | {:.4} | {:.2} | {moving} | {:.1} |",
                bakery.name,
                row.label(),
                level.faces,
                look.psnr,
                look.ssim,
                look.lit,
                made.seconds
            ));
        }
        drawn.extend(made.baked.levels.first().map(|level| level.to_model(model)));
        looks.push(of_row);
    }
    if let Some(folder) = &arguments.pictures {
        std::fs::create_dir_all(folder)?;
        let models: Vec<&Model> = drawn.iter().collect();
        side_by_side(&models).save(folder.join(format!("{}_ablations.png", bakery.name)))?;
    }
    Ok(Measured { name: bakery.name.clone(), rows: looks })
}

fn look(source: &Model, level: &Level, arguments: &Arguments) -> Result<Look, Box<dyn Error>> {
    let own = level.to_model(source);
    let [unlit, lit] = [Light::None, Light::Head].map(|light| similarity(source, &own, arguments.views, light));
    let moving = if arguments.motion { moving(source, level)? } else { None };
    Ok(Look { psnr: unlit.psnr, ssim: unlit.ssim, lit: lit.psnr, moving })
}

/// PSNR in motion, of the level as a file of its own.
fn moving(source: &Model, level: &Level) -> Result<Option<f64>, Box<dyn Error>> {
    let bytes = export_level(source, level)?;
    let file = Source { name: "level", bytes: &bytes, resources: &NoResources };
    let level = import(&file, &ImportLimits::default())?;
    let options = Options { views: 1, volume: false, motion: true, lpips: None };
    Ok(compare(source, &[&level], &options)[0].motion.map(|motion| motion.psnr))
}

/// The change of each row against all parts: means over the models, and the largest loss.
fn summary(rows: &[&Switch], faces: &[u32], all: &[Measured]) {
    let titles = |budget: &u32| format!("{budget}: PSNR, dB | worst | lit or moving");
    let columns: Vec<String> = faces.iter().map(titles).collect();
    say(&format!("\n| {} models | {} |", all.len(), columns.join(" | ")));
    say(&format!("|---|{}", "---|---|---|".repeat(faces.len())));
    for (r, row) in rows.iter().enumerate() {
        let cells: Vec<String> = (0..faces.len()).map(|level| cells(all, r, level)).collect();
        say(&format!("| {} | {} |", row.label(), cells.join(" | ")));
    }
}

/// The cells of a row and a level: values for all parts, changes for the others.
fn cells(all: &[Measured], row: usize, level: usize) -> String {
    let pairs: Vec<(&str, Look, Look)> = all
        .iter()
        .filter_map(|m| Some((m.name.as_str(), *m.rows[0].get(level)?, *m.rows.get(row)?.get(level)?)))
        .collect();
    let mean = |of: &dyn Fn(&Look, &Look) -> f64| {
        pairs.iter().map(|(_, all, own)| of(all, own)).sum::<f64>() / pairs.len().max(1) as f64
    };
    let second = |look: &Look| look.moving.unwrap_or(look.lit);
    if row == 0 {
        return format!("{:.2} | | {:.2}", mean(&|_, own| own.psnr), mean(&|_, own| second(own)));
    }
    let change = |(_, all, own): &(&str, Look, Look)| own.psnr - all.psnr;
    let worst = pairs.iter().min_by(|a, b| change(a).total_cmp(&change(b)));
    let worst = worst.map_or_else(String::new, |pair| format!("{:+.2} {}", change(pair), pair.0));
    let lit = mean(&|all, own| second(own) - second(all));
    format!("{:+.2} | {worst} | {lit:+.2}", mean(&|all, own| own.psnr - all.psnr))
}
