//! An inspection as text.

use bytesize::ByteSize;
use simpliguard::gltf::GpuCost;

use super::contents::{Clip, Contents, MaterialInfo, Mesh, Skin, TextureInfo};
use super::result::{CachedLevel, CachedResult};
use super::stages::StageResult;
use super::{Inspection, LevelSize, ObjectSize, Setting};
use crate::output::columns;

/// Items of a list that are shown; `--json` has all of them.
const MOST: usize = 20;
/// Digits of a key that are shown; `--json` has all of them.
const KEY_DIGITS: usize = 12;

pub(super) fn text(inspection: &Inspection) -> String {
    let Inspection { file, bytes, contents, levels, objects, settings, stages, .. } = inspection;
    let mut out = format!("{file}: {}\n\n", ByteSize(*bytes));
    out += &contents_text(contents);
    out += &memory_text(inspection);
    if !levels.is_empty() {
        let header = ["level", "budget", "faces", "error %", "file"];
        out += &section("levels", &header, Align::Numbers, levels, level);
    }
    let header = ["object", "instances", "triangles", "triangles of its levels"];
    out += &list("objects", &header, Align::Numbers, objects, |_, kind| object(kind));
    out += &section("settings", &["setting", "value", "origin"], Align::Words, settings, setting);
    if !stages.is_empty() {
        out += &section("stages", &["stage", "level", "result", "key", "cached"], Align::Words, stages, stage);
    }
    out += &result_text(&inspection.result, inspection.pipeline_version);
    inspection.notes.iter().for_each(|note| out += &format!("note: {note}\n"));
    out
}

fn contents_text(contents: &Contents) -> String {
    let Contents { triangles, vertices, scenes, nodes, meshes, materials, textures, skins, clips } = contents;
    let mut out = format!(
        "the default scene: {triangles} triangles, {vertices} vertices\nthe file: {scenes} scenes, {nodes} nodes, {} \
         meshes, {} materials, {} textures, {} skins, {} clips\n\n",
        meshes.len(),
        materials.len(),
        textures.len(),
        skins.len(),
        clips.len()
    );
    out += &list("meshes", &["mesh", "primitives", "morph targets"], Align::Numbers, meshes, mesh);
    out += &list("materials", &["material", "alpha", "sides", "textures"], Align::Words, materials, material);
    out += &list("textures", &["texture", "size", "memory"], Align::Numbers, textures, texture);
    out += &list("skins", &["skin", "joints"], Align::Numbers, skins, skin);
    out + &list("clips", &["clip", "seconds", "channels"], Align::Numbers, clips, clip)
}

/// The table of memory and draw calls: the source, its levels from the most detailed on, and all levels together.
fn memory_text(Inspection { source, levels, all_levels, .. }: &Inspection) -> String {
    let mut rows = vec![("source".to_owned(), *source)];
    rows.extend(levels.iter().rev().map(|level| (level.name.clone(), level.gpu)));
    if levels.len() > 1 {
        rows.push(("all levels".to_owned(), *all_levels));
    }
    let row = |(name, cost): &(String, GpuCost)| {
        let [textures, meshes] = [cost.texture_memory, cost.mesh_memory].map(|bytes| ByteSize(bytes).to_string());
        vec![name.clone(), textures, meshes, cost.draw_calls.to_string()]
    };
    section("memory on the GPU", &["", "textures", "meshes", "draw calls"], Align::Numbers, &rows, row)
}

fn result_text(CachedResult { key, cached, levels }: &CachedResult, pipeline_version: &str) -> String {
    let found = if *cached { "the cache has it" } else { "not in the cache of this machine" };
    let mut out = format!("result: key {key}, pipeline version {pipeline_version}: {found}\n");
    if !levels.is_empty() {
        let header = ["level", "budget", "faces", "error %", "PSNR"].map(str::to_owned).to_vec();
        let row = |level: &CachedLevel| {
            let psnr = level.psnr.map_or("-".to_owned(), |psnr| format!("{psnr:.1}"));
            let error = format!("{:.2}", 100.0 * level.error);
            vec![format!("LOD{}", level.level), level.budget.to_string(), level.faces.to_string(), error, psnr]
        };
        let rows: Vec<_> = std::iter::once(header).chain(levels.iter().map(row)).collect();
        out += &columns(&rows, 1, false);
    }
    out
}

/// A list of the file; nothing if it is empty.
fn list<T>(title: &str, header: &[&str], align: Align, items: &[T], row: impl Fn(usize, &T) -> Vec<String>) -> String {
    if items.is_empty() {
        return String::new();
    }
    let shown: Vec<(usize, &T)> = items.iter().enumerate().take(MOST).collect();
    let text = section(title, header, align, &shown, |(i, item)| row(*i, item));
    match items.len().saturating_sub(MOST) {
        0 => text,
        left => format!("{}\nand {left} more\n\n", text.trim_end_matches('\n')),
    }
}

/// The side that the columns behind the first are aligned to.
#[derive(Clone, Copy)]
enum Align {
    Words,
    Numbers,
}

/// A table with an empty line behind it.
fn section<T>(title: &str, header: &[&str], align: Align, items: &[T], row: impl Fn(&T) -> Vec<String>) -> String {
    let left = match align {
        Align::Words => header.len(),
        Align::Numbers => 1,
    };
    let header = header.iter().map(|cell| (*cell).to_owned()).collect();
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(items.iter().map(row)).collect();
    format!("{title}\n{}\n", columns(&rows, left, false))
}

/// The index of an item in its list, and its name.
fn named(i: usize, name: &str) -> String {
    if name.is_empty() { i.to_string() } else { format!("{i} {name}") }
}

fn mesh(i: usize, mesh: &Mesh) -> Vec<String> {
    vec![named(i, &mesh.name), mesh.primitives.to_string(), mesh.morph_targets.to_string()]
}

fn material(i: usize, material: &MaterialInfo) -> Vec<String> {
    let sides = if material.double_sided { "both" } else { "front" };
    let textures: Vec<String> = material.textures.iter().map(usize::to_string).collect();
    let textures = if textures.is_empty() { "-".to_owned() } else { textures.join(", ") };
    vec![named(i, &material.name), material.alpha_mode.to_lowercase(), sides.to_owned(), textures]
}

fn texture(i: usize, texture: &TextureInfo) -> Vec<String> {
    let size = texture.size.map_or("unreadable".to_owned(), |[width, height]| format!("{width} x {height}"));
    vec![named(i, &texture.name), size, ByteSize(texture.memory).to_string()]
}

fn skin(i: usize, skin: &Skin) -> Vec<String> {
    vec![named(i, &skin.name), skin.joints.to_string()]
}

fn clip(i: usize, clip: &Clip) -> Vec<String> {
    let seconds = clip.seconds.map_or("-".to_owned(), |seconds| format!("{seconds:.2}"));
    vec![named(i, &clip.name), seconds, clip.channels.to_string()]
}

fn level(level: &LevelSize) -> Vec<String> {
    let error = level.error.map_or("-".to_owned(), |error| format!("{:.2}", 100.0 * error));
    vec![level.name.clone(), number(level.budget), number(level.faces), error, ByteSize(level.bytes).to_string()]
}

fn object(object: &ObjectSize) -> Vec<String> {
    let faces: Vec<String> = object.levels.iter().map(|level| number(level.faces)).collect();
    vec![object.name.clone(), object.instances.to_string(), number(object.triangles), faces.join(", ")]
}

fn number(value: Option<u64>) -> String {
    value.map_or("-".to_owned(), |value| value.to_string())
}

fn stage(StageResult { stage, level, content, key, needs, cached }: &StageResult) -> Vec<String> {
    let level = level.map_or("-".to_owned(), |level| format!("LOD{level}"));
    let Some(content) = content else {
        return vec![stage.to_string(), level, "not stored".to_owned(), "-".to_owned(), "-".to_owned()];
    };
    let needs = || needs.map_or("-".to_owned(), |stage| format!("needs {stage}"));
    let key = key.as_ref().map_or_else(needs, |key| key.chars().take(KEY_DIGITS).collect());
    vec![stage.to_string(), level, content.clone(), key, if *cached { "yes" } else { "no" }.to_owned()]
}

fn setting(setting: &Setting) -> Vec<String> {
    vec![setting.name.to_owned(), setting.value.clone(), setting.origin.clone()]
}
