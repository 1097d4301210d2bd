//! Bends every hinge of characters, with and without joint planes, and prints what is lost.
//!
//! ```text
//! cargo run --release -p simpliguard_eval --example stress -- [--faces N] [--poses N] [--angle DEGREES] [--sheet PNG] FILE.glb...
//! ```

use std::error::Error;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage, imageops};
use simpliguard::animation::Skeleton;
use simpliguard::data::{Level, Model, TriMesh};
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};
use simpliguard::settings::{BakeSettings, JointSplitting};
use simpliguard::{Context, NoResources, Source, bake};
use simpliguard_eval::stress::{Bend, Hinge, bends, bent, hinges};

/// Side of one picture in pixels.
const TILE: usize = 320;
/// Hinges in the image: those at which the levels differ most.
const SHOWN: usize = 6;
/// Half of what a picture shows, in radii of the bend.
const VIEW: f32 = 4.0;

struct Arguments {
    faces: u32,
    /// Of clips that the levels are fitted to; what the settings say unless given.
    poses: Option<u32>,
    /// In radians.
    angle: f32,
    sheet: Option<PathBuf>,
    files: Vec<PathBuf>,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut out =
        Arguments { faces: 1000, poses: None, angle: std::f32::consts::FRAC_PI_2, sheet: None, files: Vec::new() };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--faces" => out.faces = value()?.parse()?,
            "--poses" => out.poses = Some(value()?.parse()?),
            "--angle" => out.angle = value()?.parse::<f32>()?.to_radians(),
            "--sheet" => out.sheet = Some(value()?.into()),
            _ => out.files.push(word.into()),
        }
    }
    if out.files.is_empty() {
        return Err("name at least one .glb file".into());
    }
    Ok(out)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    say(
        "| asset | joint planes | faces | hinges | volume lost % (source) | worst % | area that crosses at bends % (source) |",
    );
    say("|---|---|---|---|---|---|---|");
    let mut rows = Vec::new();
    for file in &arguments.files {
        rows.extend(stress(file, &arguments)?);
    }
    if let Some(path) = &arguments.sheet {
        sheet(&rows).save(path)?;
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the table is this program's output")]
fn say(line: &str) {
    println!("{line}");
}

/// Bakes a file with and without joint planes, prints a row for each, and returns the pictures of the hinges shown.
fn stress(file: &Path, arguments: &Arguments) -> Result<Vec<RgbImage>, Box<dyn Error>> {
    let bytes = std::fs::read(file)?;
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let source = Source { name: &name, bytes: &bytes, resources: &NoResources };
    let mut made: Vec<(Model, Level)> = Vec::new();
    for joint_planes in [JointSplitting::Off, JointSplitting::BeforeUnwrap] {
        let default = BakeSettings::default();
        let poses = arguments.poses.unwrap_or(default.poses);
        let settings = BakeSettings { faces: vec![arguments.faces], poses, joint_planes, ..default };
        let mut baked = bake(&source, &settings, &Context::default())?;
        let (Some(model), Some(level)) = (baked.model, baked.levels.pop()) else {
            return Err(format!("{name} gets no level of {} faces", arguments.faces).into());
        };
        made.push((model, level));
    }
    let model = &made[0].0;
    let hinges = hinges(model);
    let surface = &model.surface;
    let of_source =
        bends(model, &hinges, arguments.angle, &mesh(&surface.positions, &surface.triangles), &surface.influences);
    let of_levels: Vec<Vec<Bend>> = made
        .iter()
        .map(|(_, Level { mesh: m, .. })| {
            bends(model, &hinges, arguments.angle, &mesh(&m.positions, &m.triangles), &m.influences)
        })
        .collect();
    for ((what, found), (_, level)) in ["off", "on"].iter().zip(&of_levels).zip(&made) {
        say(&row(&name, what, level.mesh.triangles.len(), found, &of_source));
    }
    let mut shown: Vec<usize> = (0..hinges.len()).collect();
    let gain = |&i: &usize| (of_levels[0][i].volume_loss - of_levels[1][i].volume_loss).abs();
    shown.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
    let levels: Vec<&Level> = made.iter().map(|(_, level)| level).collect();
    Ok(shown.iter().take(SHOWN).map(|&i| image(model, &levels, &hinges[i], arguments.angle)).collect())
}

fn mesh(positions: &[glam::Vec3], triangles: &[[u32; 3]]) -> TriMesh {
    TriMesh { positions: positions.to_vec(), triangles: triangles.to_vec() }
}

fn row(name: &str, planes: &str, faces: usize, found: &[Bend], source: &[Bend]) -> String {
    let percent =
        |bends: &[Bend], of: fn(&Bend) -> f64| 100.0 * bends.iter().map(of).sum::<f64>() / bends.len().max(1) as f64;
    let (volume, crossing): (fn(&Bend) -> f64, fn(&Bend) -> f64) = (|b| b.volume_loss, |b| b.crossing);
    let worst = 100.0 * found.iter().map(volume).fold(0.0, f64::max);
    format!(
        "| {name} | {planes} | {faces} | {} | {:.1} ({:.1}) | {worst:.1} | {:.1} ({:.1}) |",
        found.len(),
        percent(found, volume),
        percent(source, volume),
        percent(found, crossing),
        percent(source, crossing),
    )
}

/// A hinge bent, seen along its axis from the side that nothing hides: the source, the level without and the level with
/// joint planes.
fn image(model: &Model, levels: &[&Level], hinge: &Hinge, angle: f32) -> RgbImage {
    let source = bent(model, hinge, angle, &model.surface.positions, &model.surface.influences);
    let whole = BoundingSphere::around(&source);
    let centre = Skeleton::of(model).map_or(whole.centre, |joints| joints.place(hinge.joint));
    let side = if hinge.axis.dot(centre - whole.centre) < 0.0 { -hinge.axis } else { hinge.axis };
    let frame = BoundingSphere { centre, radius: whole.radius + centre.distance(whole.centre) };
    let camera = Camera::orbit(&frame, side, 0.6, VIEW * hinge.radius / frame.radius);
    let mut out = RgbImage::from_pixel((levels.len() as u32 + 1) * TILE as u32, TILE as u32, Rgb([255; 3]));
    let mut draw = |column: usize, model: &Model, positions: &[glam::Vec3]| {
        let sampler = SurfaceSampler::new(model);
        let [image] = Renderer::new(&sampler, TILE, 2).draw_moved(positions, &camera, [Light::Head]);
        let tile = image.over(1.0);
        imageops::replace(&mut out, &image::DynamicImage::ImageRgba8(tile).to_rgb8(), (column * TILE) as i64, 0);
    };
    draw(0, model, &source);
    for (column, level) in levels.iter().enumerate() {
        let positions = bent(model, hinge, angle, &level.mesh.positions, &level.mesh.influences);
        draw(column + 1, &level.to_model(model), &positions);
    }
    out
}

/// Rows of pictures, one below the other.
fn sheet(rows: &[RgbImage]) -> RgbImage {
    let width = rows.iter().map(RgbImage::width).max().unwrap_or(1);
    let mut out = RgbImage::from_pixel(width, rows.iter().map(RgbImage::height).sum::<u32>().max(1), Rgb([255; 3]));
    let mut y = 0;
    for row in rows {
        imageops::replace(&mut out, row, 0, y);
        y += i64::from(row.height());
    }
    out
}
