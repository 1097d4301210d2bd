//! The models of the 3-D view: the levels of a bake as they are, and their source with fewer triangles, in one binary glTF.
//!
//! They share skeleton, clips and materials. The viewer shows the node of one level or the nodes of the source.

mod arrays;
mod decimate;
mod images;
mod writer;

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Value, json};
use simpliguard::data::Document;

use self::images::{Encoding, Picture};
use self::writer::Writer;
use crate::inspect::document::{Document as Lists, index};
use crate::levels::{LevelNode, indices};

/// What the models of a view may take up, from the most to the least.
const STEPS: [Limits; 7] = [
    Limits::new(None, None, None),
    Limits::new(Some(30_000), Some((1024, 88)), Some((1024, 90))),
    Limits::new(Some(20_000), Some((512, 82)), Some((1024, 85))),
    Limits::new(Some(15_000), Some((512, 78)), Some((1024, 78))),
    Limits::new(Some(12_000), Some((512, 72)), Some((512, 78))),
    Limits::new(Some(8_000), Some((256, 70)), Some((512, 70))),
    Limits::new(Some(5_000), Some((128, 70)), Some((256, 70))),
];

/// A limit of the models of a view.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// Triangles of the source, with all instances; `None` for all.
    triangles: Option<usize>,
    /// Images of the source, and those of the levels; `None` for images as they are.
    source: Option<Encoding>,
    levels: Option<Encoding>,
}

/// The models of a view.
#[derive(Clone, Debug)]
pub(super) struct Preview {
    /// Binary glTF. A level's node has its number in `extras.simpliguard.level`.
    pub(super) glb: Vec<u8>,
    pub(super) made: Made,
}

/// What the models of a view are made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Made {
    /// Triangles of the source in the view.
    pub(super) triangles: usize,
    /// Longest side of the source's textures; `None` if they are as in the file.
    pub(super) source_texture: Option<u32>,
    /// Longest side of the levels' textures; `None` if they are as in the file.
    pub(super) level_texture: Option<u32>,
}

impl Limits {
    const fn new(triangles: Option<usize>, source: Option<(u32, u8)>, levels: Option<(u32, u8)>) -> Self {
        Self { triangles, source: encoding(source), levels: encoding(levels) }
    }
}

const fn encoding(of: Option<(u32, u8)>) -> Option<Encoding> {
    match of {
        Some((side, quality)) => Some(Encoding { side, quality }),
        None => None,
    }
}

/// The models of a bake's output, in at most `bytes`; if nothing is as small as that, as small as they get. `None` if the
/// document cannot be read.
pub(super) fn preview(document: &Document, levels: &[LevelNode], bytes: usize) -> Option<Preview> {
    let shown = Shown::new(document, levels)?;
    let mut last = None;
    for limits in &STEPS {
        let is_whole = limits.triangles.is_none();
        // What is far too large as it is need not be written to see that.
        if is_whole && document.buffers.iter().map(|buffer| buffer.len()).sum::<usize>() > 4 * bytes {
            continue;
        }
        let preview = shown.write(limits)?;
        let fits = preview.glb.len() <= bytes;
        last = Some(preview);
        if fits {
            break;
        }
    }
    last
}

/// What the view shows of a document.
struct Shown<'a> {
    document: &'a Document,
    levels: &'a [LevelNode],
    roots: Vec<usize>,
    /// Nodes that are shown, and those that move them.
    nodes: BTreeSet<usize>,
    /// Meshes of the source with the number of times that they stand in the scene, and those of the levels.
    source_meshes: BTreeMap<usize, usize>,
    level_meshes: BTreeSet<usize>,
    skins: BTreeSet<usize>,
    /// Images that are shown, and whether a level shows them.
    images: BTreeMap<usize, (bool, Picture)>,
    /// Triangles of the source, with all instances.
    triangles: usize,
}

impl<'a> Shown<'a> {
    fn new(document: &'a Document, levels: &'a [LevelNode]) -> Option<Self> {
        let json = &document.json;
        let scene = index(json, "scene").unwrap_or(0);
        let mut roots = indices(json.get("scenes")?.get(scene)?, "nodes");
        let list = json.get("nodes")?.as_array()?;
        let mut nodes = below(list, &roots);
        let is_level = |node: &usize| levels.iter().any(|level| level.node == *node);
        for level in levels.iter().filter(|level| !nodes.contains(&level.node)) {
            roots.push(level.node);
        }
        nodes.extend(below(list, &roots));
        let (mut source_meshes, mut level_meshes, mut skins) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
        for &node in &nodes {
            let Some(mesh) = list.get(node).and_then(|node| index(node, "mesh")) else { continue };
            skins.extend(index(&list[node], "skin"));
            if is_level(&node) {
                level_meshes.insert(mesh);
            } else {
                *source_meshes.entry(mesh).or_insert(0) += 1;
            }
        }
        for skin in &skins {
            nodes.extend(indices(json.get("skins")?.get(*skin)?, "joints"));
        }
        let mut shown = Self {
            document,
            levels,
            roots,
            nodes,
            source_meshes,
            level_meshes,
            skins,
            images: BTreeMap::new(),
            triangles: 0,
        };
        shown.triangles = shown.source_meshes.iter().map(|(mesh, times)| times * shown.triangles_of(*mesh)).sum();
        shown.read_images();
        Some(shown)
    }

    fn read_images(&mut self) {
        let lists = Lists::of(self.document);
        let images = |meshes: &mut dyn Iterator<Item = &usize>| -> BTreeSet<usize> {
            meshes.flat_map(|mesh| lists.images_of_mesh(*mesh)).collect()
        };
        let of_levels = images(&mut self.level_meshes.iter());
        for image in images(&mut self.source_meshes.keys()).union(&of_levels) {
            if let Some(picture) = Picture::read(self.document, *image) {
                self.images.insert(*image, (of_levels.contains(image), picture));
            }
        }
    }

    fn triangles_of(&self, mesh: usize) -> usize {
        let accessors = self.document.json.get("accessors");
        let count = |primitive: &Value| {
            let positions = || index(primitive.get("attributes")?, "POSITION");
            let accessor = index(primitive, "indices").or_else(positions)?;
            index(accessors?.get(accessor)?, "count")
        };
        primitives(&self.document.json, mesh).iter().filter_map(count).map(|count| count / 3).sum()
    }

    /// The file within limits. `None` if the document cannot be read.
    fn write(&self, limits: &Limits) -> Option<Preview> {
        let mut json = self.document.json.clone();
        let mut writer = Writer::new(self.document);
        let fraction = limits.triangles.map_or(1.0, |most| most as f64 / self.triangles.max(1) as f64);
        let mut triangles = 0;
        for (i, mesh) in json.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
            let times = self.source_meshes.get(&i);
            let primitives = mesh.get_mut("primitives")?.as_array_mut()?;
            if times.is_none() && !self.level_meshes.contains(&i) {
                primitives.clear();
            }
            for primitive in primitives {
                match times {
                    Some(times) => triangles += times * writer.decimated(primitive, fraction)?,
                    None => writer.primitive(primitive)?,
                }
            }
        }
        writer.skins(&mut json, &self.skins)?;
        writer.clips(&mut json, &self.nodes)?;
        self.write_nodes(&mut json, &mut writer)?;
        self.write_images(&mut json, &mut writer, limits);
        json["scenes"] = json!([{ "nodes": self.roots }]);
        json["scene"] = 0.into();
        let side = |encoding: Option<Encoding>| encoding.map(|encoding| encoding.side);
        let made = Made { triangles, source_texture: side(limits.source), level_texture: side(limits.levels) };
        Some(Preview { glb: writer.finish(json)?, made })
    }

    /// Leaves nothing in nodes that are not shown.
    fn write_nodes(&self, json: &mut Value, writer: &mut Writer<'_>) -> Option<()> {
        for (i, node) in json.get_mut("nodes")?.as_array_mut()?.iter_mut().enumerate() {
            if self.nodes.contains(&i) {
                writer.instances(node)?;
            } else {
                *node = json!({});
            }
            if let Some(extensions) = node.get_mut("extensions").and_then(Value::as_object_mut) {
                extensions.remove("MSFT_lod");
            }
            let is_level = self.levels.iter().any(|level| level.node == i);
            if let (false, Some(node)) = (is_level, node.as_object_mut()) {
                node.remove("extras");
            }
        }
        Some(())
    }

    fn write_images(&self, json: &mut Value, writer: &mut Writer<'_>, limits: &Limits) {
        for (i, image) in json.get_mut("images").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
            let encoding = |is_of_level: bool| if is_of_level { limits.levels } else { limits.source };
            *image = match self.images.get(&i) {
                Some((is_of_level, picture)) => {
                    let (bytes, mime) = picture.encoded(encoding(*is_of_level));
                    json!({"bufferView": writer.view(&bytes), "mimeType": mime})
                }
                // Nothing shows it, or it cannot be read.
                None => json!({"uri": "data:,"}),
            };
        }
        for texture in json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
            if let Some(webp) = texture.pointer("/extensions/EXT_texture_webp/source").cloned() {
                texture["source"] = webp;
            }
            texture.as_object_mut().map(|texture| texture.remove("extensions"));
        }
    }
}

fn primitives(json: &Value, mesh: usize) -> &[Value] {
    let mesh = json.get("meshes").and_then(|meshes| meshes.get(mesh));
    mesh.and_then(|mesh| mesh.get("primitives")?.as_array()).map(Vec::as_slice).unwrap_or_default()
}

/// Nodes and all below them.
fn below(nodes: &[Value], roots: &[usize]) -> BTreeSet<usize> {
    let (mut seen, mut left) = (BTreeSet::new(), roots.to_vec());
    while let Some(next) = left.pop() {
        if let (true, Some(node)) = (seen.insert(next), nodes.get(next)) {
            left.extend(indices(node, "children"));
        }
    }
    seen
}
