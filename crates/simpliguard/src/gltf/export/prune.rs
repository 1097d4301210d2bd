//! Removal of objects that nothing refers to, down to the byte ranges of shared buffer views.
//!
//! References in extensions are followed for the extensions that the import knows, for textures in any material
//! extension, and for `EXT_mesh_gpu_instancing`, `KHR_draco_mesh_compression` and `KHR_materials_variants`.

use serde_json::{Value, json};

use super::builder::{Builder, Kind, append_aligned, index};
use super::ranges::Ranges;

/// Keeps all objects of the kinds `roots` and all objects they refer to; removes the others and renumbers.
pub(in crate::gltf) fn prune(out: &mut Builder, roots: &[Kind]) {
    let used = mark(out, roots);
    repack(out, &used);
    let places: Vec<Vec<Option<usize>>> = used.0.iter().map(|flags| new_places(flags)).collect();
    for kind in Kind::ALL {
        let flags = &used.0[kind as usize];
        if flags.is_empty() {
            continue;
        }
        let mut i = 0;
        let all = out.all_mut(kind);
        all.retain(|_| {
            i += 1;
            flags[i - 1]
        });
        for object in all {
            each_reference(kind, object, &mut |target, reference| {
                let old = reference.as_u64().unwrap_or(u64::MAX);
                let new = places[target as usize].get(old as usize).copied().flatten();
                *reference = json!(new);
            });
        }
    }
    retain_used_extensions(out);
}

/// For each kind, a flag per object: true if it is used.
struct Used(Vec<Vec<bool>>);

impl Used {
    fn has(&self, kind: Kind, i: usize) -> bool {
        self.0[kind as usize].get(i).copied().unwrap_or(false)
    }
}

fn mark(out: &mut Builder, roots: &[Kind]) -> Used {
    let mut used = Used(Kind::ALL.map(|kind| vec![false; out.all(kind).len()]).to_vec());
    let mut open: Vec<(Kind, usize)> =
        roots.iter().flat_map(|&kind| (0..out.all(kind).len()).map(move |i| (kind, i))).collect();
    while let Some((kind, i)) = open.pop() {
        match used.0[kind as usize].get_mut(i) {
            Some(flag) if !*flag => *flag = true,
            _ => continue,
        }
        each_reference(kind, &mut out.all_mut(kind)[i], &mut |target, reference| {
            open.extend(reference.as_u64().map(|i| (target, i as usize)));
        });
    }
    used
}

fn new_places(flags: &[bool]) -> Vec<Option<usize>> {
    let mut next = 0;
    flags
        .iter()
        .map(|&used| {
            used.then(|| {
                next += 1;
                next - 1
            })
        })
        .collect()
}

/// Calls `visit` with each reference an object holds into one of the top-level arrays.
pub(in crate::gltf) fn each_reference(kind: Kind, object: &mut Value, visit: &mut dyn FnMut(Kind, &mut Value)) {
    match kind {
        Kind::Scene => each(object.get_mut("nodes"), Kind::Node, visit),
        Kind::Node => {
            each(object.get_mut("children"), Kind::Node, visit);
            one(object.get_mut("mesh"), Kind::Mesh, visit);
            one(object.get_mut("skin"), Kind::Skin, visit);
            one(object.get_mut("camera"), Kind::Camera, visit);
            each(object.pointer_mut("/extensions/MSFT_lod/ids"), Kind::Node, visit);
            each(object.pointer_mut("/extensions/EXT_mesh_gpu_instancing/attributes"), Kind::Accessor, visit);
        }
        Kind::Mesh => items(object.get_mut("primitives")).for_each(|p| primitive_references(p, visit)),
        Kind::Skin => {
            each(object.get_mut("joints"), Kind::Node, visit);
            one(object.get_mut("skeleton"), Kind::Node, visit);
            one(object.get_mut("inverseBindMatrices"), Kind::Accessor, visit);
        }
        Kind::Animation => {
            items(object.get_mut("channels")).for_each(|c| one(c.pointer_mut("/target/node"), Kind::Node, visit));
            for sampler in items(object.get_mut("samplers")) {
                one(sampler.get_mut("input"), Kind::Accessor, visit);
                one(sampler.get_mut("output"), Kind::Accessor, visit);
            }
        }
        Kind::Material => {
            each(object.pointer_mut("/extensions/MSFT_lod/ids"), Kind::Material, visit);
            texture_references(object, visit);
        }
        Kind::Texture => {
            one(object.get_mut("sampler"), Kind::Sampler, visit);
            one(object.get_mut("source"), Kind::Image, visit);
            items(object.get_mut("extensions")).for_each(|e| one(e.get_mut("source"), Kind::Image, visit));
        }
        Kind::Image => {
            one(object.get_mut("bufferView"), Kind::BufferView, visit);
            one(object.pointer_mut("/extras/simpliguard/bc7/bufferView"), Kind::BufferView, visit);
        }
        Kind::Accessor => {
            for pointer in ["/bufferView", "/sparse/indices/bufferView", "/sparse/values/bufferView"] {
                one(object.pointer_mut(pointer), Kind::BufferView, visit);
            }
        }
        Kind::Camera | Kind::Sampler | Kind::BufferView => {}
    }
}

fn primitive_references(primitive: &mut Value, visit: &mut dyn FnMut(Kind, &mut Value)) {
    each(primitive.get_mut("attributes"), Kind::Accessor, visit);
    one(primitive.get_mut("indices"), Kind::Accessor, visit);
    one(primitive.get_mut("material"), Kind::Material, visit);
    items(primitive.get_mut("targets")).for_each(|t| each(Some(t), Kind::Accessor, visit));
    one(primitive.pointer_mut("/extensions/KHR_draco_mesh_compression/bufferView"), Kind::BufferView, visit);
    for mapping in items(primitive.pointer_mut("/extensions/KHR_materials_variants/mappings")) {
        one(mapping.get_mut("material"), Kind::Material, visit);
    }
}

/// Visits texture references: members named `...Texture`, in the material itself and in its extensions.
fn texture_references(value: &mut Value, visit: &mut dyn FnMut(Kind, &mut Value)) {
    let Some(members) = value.as_object_mut() else { return };
    for (name, member) in members {
        if name.ends_with("Texture") {
            one(member.get_mut("index"), Kind::Texture, visit);
        } else if name != "extras" {
            texture_references(member, visit);
        }
    }
}

fn one(reference: Option<&mut Value>, kind: Kind, visit: &mut dyn FnMut(Kind, &mut Value)) {
    if let Some(reference) = reference.filter(|r| r.is_u64()) {
        visit(kind, reference);
    }
}

fn each(references: Option<&mut Value>, kind: Kind, visit: &mut dyn FnMut(Kind, &mut Value)) {
    items(references).for_each(|r| one(Some(r), kind, visit));
}

/// The elements of an array or the members of an object.
fn items(value: Option<&mut Value>) -> Box<dyn Iterator<Item = &mut Value> + '_> {
    match value {
        Some(Value::Array(all)) => Box::new(all.iter_mut()),
        Some(Value::Object(all)) => Box::new(all.values_mut()),
        _ => Box::new(std::iter::empty()),
    }
}

/// Rebuilds buffer 0 from the byte ranges that are used.
fn repack(out: &mut Builder, used: &Used) {
    let ranges = used_ranges(out, used);
    let mut bin = Vec::new();
    let source = std::mem::take(&mut out.bin);
    for (v, view) in out.all_mut(Kind::BufferView).iter_mut().enumerate() {
        if !used.has(Kind::BufferView, v) {
            continue;
        }
        move_view(view, &source, &mut bin, &ranges[v]);
    }
    for accessor in out.all_mut(Kind::Accessor) {
        let Some(ranges) = index(accessor, "bufferView").and_then(|v| ranges.get(v)) else { continue };
        let offset = index(accessor, "byteOffset").unwrap_or(0);
        if offset > 0 {
            accessor["byteOffset"] = json!(ranges.moved(offset));
        }
    }
    out.bin = bin;
}

/// Appends the used ranges of a view to `bin` and points the view at them.
fn move_view(view: &mut Value, source: &[u8], bin: &mut Vec<u8>, ranges: &Ranges) {
    let (offset, length) = (index(view, "byteOffset").unwrap_or(0), index(view, "byteLength").unwrap_or(0));
    let bytes = offset.checked_add(length).and_then(|end| source.get(offset..end)).unwrap_or_default();
    let start = append_aligned(bin, &[]);
    for range in ranges.within(length) {
        bin.extend_from_slice(bytes.get(range).unwrap_or_default());
    }
    view["byteOffset"] = json!(start);
    view["byteLength"] = json!(bin.len() - start);
}

/// The bytes of each buffer view that used objects refer to, relative to the view.
fn used_ranges(out: &Builder, used: &Used) -> Vec<Ranges> {
    let views = out.all(Kind::BufferView);
    let mut ranges: Vec<Ranges> = views
        .iter()
        .map(|view| if view.get("extensions").is_some() { Ranges::whole() } else { Ranges::default() })
        .collect();
    let mut accessed = vec![false; views.len()];
    for (a, accessor) in out.all(Kind::Accessor).iter().enumerate() {
        let Some(view) = index(accessor, "bufferView").filter(|&v| v < views.len()) else { continue };
        if used.has(Kind::Accessor, a) {
            accessed[view] = true;
            ranges[view].add_accessor(accessor, index(&views[view], "byteStride"));
        }
        for sparse in ["/sparse/indices", "/sparse/values"] {
            let view = accessor.pointer(sparse).and_then(|s| index(s, "bufferView"));
            if let Some(view) = view.filter(|&v| v < views.len()) {
                ranges[view] = Ranges::whole();
            }
        }
    }
    // Images and references in extensions use the whole view.
    for (range, accessed) in ranges.iter_mut().zip(accessed) {
        if !accessed {
            *range = Ranges::whole();
        }
    }
    for image in out.all(Kind::Image) {
        if let Some(view) = index(image, "bufferView").filter(|&v| v < views.len()) {
            ranges[view] = Ranges::whole();
        }
    }
    ranges.iter_mut().for_each(Ranges::merge);
    ranges
}

/// Drops the declarations of extensions that no object has any more. `KHR_mesh_quantization` is visible only in the
/// component types of vertices, so its declaration stays.
pub(in crate::gltf) fn retain_used_extensions(out: &mut Builder) {
    let mut present = vec!["KHR_mesh_quantization".to_owned()];
    out.json.values().for_each(|v| collect_extensions(v, &mut present));
    if let Some(root) = out.json.get("extensions").and_then(Value::as_object) {
        present.extend(root.keys().cloned());
    }
    for list in ["extensionsUsed", "extensionsRequired"] {
        if let Some(names) = out.json.get_mut(list).and_then(Value::as_array_mut) {
            names.retain(|name| name.as_str().is_some_and(|n| present.iter().any(|p| p == n)));
        }
    }
}

fn collect_extensions(value: &Value, present: &mut Vec<String>) {
    match value {
        Value::Array(all) => all.iter().for_each(|v| collect_extensions(v, present)),
        Value::Object(members) => {
            if let Some(Value::Object(extensions)) = members.get("extensions") {
                for name in extensions.keys() {
                    if !present.contains(name) {
                        present.push(name.clone());
                    }
                }
            }
            members.values().for_each(|v| collect_extensions(v, present));
        }
        _ => {}
    }
}
