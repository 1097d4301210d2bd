//! The models of the 3-D view: the levels of a bake as they are, and their source with fewer triangles, in one binary glTF.
//!
//! They share skeleton, clips and materials. The viewer shows the nodes of one level or those of the source: a node says in
//! `extras.parts` which of these it belongs to, 0 for the source and 1 for the first level, whose names are in `extras.levels` of
//! the file.

mod arrays;
mod decimate;
mod images;
mod scale;
mod writer;

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Value, json};
use simpliguard::data::Document;

use self::arrays::Array;
use self::decimate::{Decimation, Primitive};
use self::images::{Encoding, Picture};
use self::scale::scale_of_mesh;
use self::writer::Writer;
use crate::inspect::document::{Document as Lists, TRIANGLES, index, triangles_of_primitive};
use crate::levels::{Levels, attach, below, indices};

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

/// The part of a view that shows the source.
const SOURCE: usize = 0;

/// A limit of the models of a view.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// Triangles of the source, with all instances, if they can be as few without an error that shows; `None` for all.
    triangles: Option<usize>,
    /// Images of the source, and those of the levels; `None` for images as they are.
    source: Option<Encoding>,
    levels: Option<Encoding>,
}

/// The models of a view.
#[derive(Clone, Debug)]
pub(super) struct Preview {
    /// Binary glTF.
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

/// The models of a bake's output, whose source has a `radius`, in at most `bytes`; if nothing is as small as that, as small
/// as they get. `None` if the document cannot be read.
pub(super) fn preview(document: &Document, levels: &Levels, radius: f32, bytes: usize) -> Option<Preview> {
    let shown = Shown::new(document, levels)?;
    let mut decimation = Decimation::new(shown.primitives_of_source(), radius.into());
    let mut last = None;
    for limits in &STEPS {
        let is_whole = limits.triangles.is_none();
        // What is far too large as it is need not be written to see that.
        if is_whole && document.buffers.iter().map(|buffer| buffer.len()).sum::<usize>() > 4 * bytes {
            continue;
        }
        if let Some(triangles) = limits.triangles {
            decimation.reduce_to(triangles);
        }
        let preview = shown.write(limits, &decimation)?;
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
    /// The document with all levels in the tree of its scene.
    json: Value,
    roots: Vec<usize>,
    /// Nodes that are shown, and those that move them.
    nodes: BTreeSet<usize>,
    /// The parts that a node with a mesh belongs to, ascending.
    parts: BTreeMap<usize, Vec<usize>>,
    /// Names of the parts from 1 on.
    levels: Vec<&'a str>,
    /// Meshes of the source with the nodes that show them, and those of the levels.
    source_meshes: BTreeMap<usize, Vec<usize>>,
    level_meshes: BTreeSet<usize>,
    skins: BTreeSet<usize>,
    /// Images that are shown, and whether a level shows them.
    images: BTreeMap<usize, (bool, Picture)>,
}

impl<'a> Shown<'a> {
    fn new(document: &'a Document, levels: &'a Levels) -> Option<Self> {
        let mut json = document.json.clone();
        let parts = parts(levels);
        let roots = attach(&mut json, &parts.keys().copied().collect::<Vec<_>>())?;
        let mut nodes = below(&json, &roots);
        let (mut source_meshes, mut level_meshes, mut skins) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
        for (&place, parts) in &parts {
            let Some(node) = json.get("nodes")?.get(place) else { continue };
            let Some(mesh) = index(node, "mesh") else { continue };
            skins.extend(index(node, "skin"));
            if parts.contains(&SOURCE) {
                source_meshes.entry(mesh).or_insert_with(Vec::new).push(place);
            }
            if *parts != [SOURCE] {
                level_meshes.insert(mesh);
            }
        }
        for skin in &skins {
            nodes.extend(indices(json.get("skins")?.get(*skin)?, "joints"));
        }
        let names = levels.all.iter().map(|level| level.name.as_str()).collect();
        let images = images_of(document, &source_meshes, &level_meshes);
        Some(Self { document, json, roots, nodes, parts, levels: names, source_meshes, level_meshes, skins, images })
    }

    /// The primitives that the source alone shows and that can be decimated: what levels show, too, keeps the geometry of the
    /// bake.
    fn primitives_of_source(&self) -> BTreeMap<(usize, usize), Primitive> {
        let mut primitives = BTreeMap::new();
        for (&mesh, nodes) in self.source_meshes.iter().filter(|(mesh, _)| !self.level_meshes.contains(mesh)) {
            let scale = nodes.iter().map(|&node| scale_of_mesh(self.document, node)).fold(f64::MIN_POSITIVE, f64::max);
            let all = self.json.get("meshes").and_then(|meshes| meshes.get(mesh)?.get("primitives")?.as_array());
            for (i, primitive) in all.into_iter().flatten().enumerate() {
                let read = self.triangles_of(primitive);
                let read = read.and_then(|(positions, indices)| Primitive::new(positions, indices, nodes.len(), scale));
                primitives.extend(read.map(|read| ((mesh, i), read)));
            }
        }
        primitives
    }

    /// Positions and triangles of a primitive. `None` if it has others than single triangles of floats.
    fn triangles_of(&self, primitive: &Value) -> Option<(Vec<[f32; 3]>, Vec<u32>)> {
        (primitive.get("mode").and_then(Value::as_u64).unwrap_or(TRIANGLES) == TRIANGLES).then_some(())?;
        let positions = Array::read(self.document, index(primitive.get("attributes")?, "POSITION")?)?.positions()?;
        let indices = match index(primitive, "indices") {
            Some(indices) => Array::read(self.document, indices)?.indices()?,
            None => (0..positions.len() as u32).collect(),
        };
        Some((positions, indices))
    }

    /// The file within limits, with the triangles of a decimation. `None` if the document cannot be read.
    fn write(&self, limits: &Limits, decimation: &Decimation) -> Option<Preview> {
        let mut json = self.json.clone();
        let mut writer = Writer::new(self.document);
        let mut triangles = 0;
        for (i, mesh) in json.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
            let primitives = mesh.get_mut("primitives")?.as_array_mut()?;
            let times = self.source_meshes.get(&i).map_or(0, Vec::len);
            if times == 0 && !self.level_meshes.contains(&i) {
                primitives.clear();
            }
            for (k, primitive) in primitives.iter_mut().enumerate() {
                match decimation.indices(i, k) {
                    Some(indices) => {
                        triangles += times * indices.len() / 3;
                        writer.decimated(primitive, indices)?;
                    }
                    None => {
                        triangles += times * triangles_of_primitive(&self.json, primitive).unwrap_or(0) as usize;
                        writer.primitive(primitive)?;
                    }
                }
            }
        }
        writer.skins(&mut json, &self.skins)?;
        writer.clips(&mut json, &self.nodes)?;
        self.write_nodes(&mut json, &mut writer)?;
        self.write_images(&mut json, &mut writer, limits);
        json["extras"] = json!({ "levels": self.levels });
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
            let node = node.as_object_mut()?;
            node.remove("extras");
            if let Some(parts) = self.parts.get(&i) {
                node.insert("extras".into(), json!({ "parts": parts }));
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

/// The parts of a view that each node belongs to: the source and the levels.
fn parts(levels: &Levels) -> BTreeMap<usize, Vec<usize>> {
    let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let nodes = std::iter::once(&levels.source).chain(levels.all.iter().map(|level| &level.nodes));
    for (part, nodes) in (SOURCE..).zip(nodes) {
        nodes.iter().for_each(|&node| parts.entry(node).or_default().push(part));
    }
    parts
}

/// The images that meshes of the source and of levels show, and whether a level shows them.
fn images_of(
    document: &Document,
    source_meshes: &BTreeMap<usize, Vec<usize>>,
    level_meshes: &BTreeSet<usize>,
) -> BTreeMap<usize, (bool, Picture)> {
    let lists = Lists::of(document);
    let images = |meshes: &mut dyn Iterator<Item = &usize>| -> BTreeSet<usize> {
        meshes.flat_map(|mesh| lists.images_of_mesh(*mesh)).collect()
    };
    let of_levels = images(&mut level_meshes.iter());
    let all: BTreeSet<usize> = images(&mut source_meshes.keys()).union(&of_levels).copied().collect();
    let read = |image: usize| Some((image, (of_levels.contains(&image), Picture::read(document, image)?)));
    all.into_iter().filter_map(read).collect()
}
