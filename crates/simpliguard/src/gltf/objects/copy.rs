//! Copies of meshes, materials, textures, accessors and their bytes from one document into another.

use std::collections::HashMap;

use serde_json::{Value, json};

use crate::gltf::export::builder::{Builder, Kind, append_aligned, index};
use crate::gltf::export::prune::each_reference;
use crate::gltf::export::ranges::element_size;

/// Copies objects between two documents, each once, with everything that they refer to. Nodes, skins, cameras and clips are
/// not followed.
pub(super) struct Copier {
    places: HashMap<(usize, usize), usize>,
    /// Leaves out what changes no level: names but those of materials, and what other programs have written beside.
    is_canonical: bool,
}

impl Copier {
    pub(super) fn new(is_canonical: bool) -> Self {
        Self { places: HashMap::new(), is_canonical }
    }

    /// Tells where materials of the one document stand in the other, so that they are not copied.
    pub(super) fn know_materials(&mut self, places: impl IntoIterator<Item = (usize, usize)>) {
        self.places.extend(places.into_iter().map(|(from, to)| ((Kind::Material as usize, from), to)));
    }

    /// The materials that were copied, with their places.
    pub(super) fn materials(&self) -> impl Iterator<Item = (usize, usize)> {
        let is_material = |(kind, _): &(usize, usize)| *kind == Kind::Material as usize;
        self.places.iter().filter(move |(from, _)| is_material(from)).map(|((_, from), to)| (*from, *to))
    }

    /// Copies object `i` of `kind`, and returns its place. `None` if there is no such object.
    pub(super) fn copy(&mut self, from: &Builder, to: &mut Builder, kind: Kind, i: usize) -> Option<usize> {
        if let Some(place) = self.places.get(&(kind as usize, i)) {
            return Some(*place);
        }
        let mut object = from.all(kind).get(i)?.clone();
        if self.is_canonical {
            strip(kind, &mut object);
        }
        match kind {
            Kind::BufferView => copy_view(from, to, &mut object)?,
            Kind::Accessor => self.copy_accessor(from, to, &mut object),
            _ => self.copy_references(from, to, kind, &mut object),
        }
        let place = to.push(kind, object);
        self.places.insert((kind as usize, i), place);
        Some(place)
    }

    /// Copies what an object refers to, and makes its references those of the copies. A reference to nothing stays one:
    /// there are no more copies than originals.
    pub(super) fn copy_references(&mut self, from: &Builder, to: &mut Builder, kind: Kind, object: &mut Value) {
        each_reference(kind, object, &mut |target, reference| {
            if matches!(target, Kind::Node | Kind::Skin | Kind::Camera) {
                return;
            }
            let place = reference.as_u64().and_then(|i| self.copy(from, to, target, usize::try_from(i).ok()?));
            if let Some(place) = place {
                *reference = json!(place);
            }
        });
    }

    /// Gives an accessor a view of its own, so that neither its neighbours nor the layout of its file count.
    fn copy_accessor(&mut self, from: &Builder, to: &mut Builder, accessor: &mut Value) {
        let Some((view, bytes)) = elements(from, accessor, !self.is_canonical) else {
            return self.copy_references(from, to, Kind::Accessor, accessor);
        };
        let Some(members) = accessor.as_object_mut() else { return };
        ["bufferView", "byteOffset"].iter().for_each(|key| drop(members.remove(*key)));
        self.copy_references(from, to, Kind::Accessor, accessor);
        accessor["bufferView"] = json!(push_view(to, view, &bytes));
    }
}

/// The bytes of an accessor's elements, and their view. `None` without a view, or if the view is too short.
fn elements(from: &Builder, accessor: &Value, keeps_target: bool) -> Option<(Value, Vec<u8>)> {
    let view = from.all(Kind::BufferView).get(index(accessor, "bufferView")?)?;
    let bytes = view_bytes(from, view)?.get(index(accessor, "byteOffset").unwrap_or(0)..)?;
    let (size, count) = (element_size(accessor)?, index(accessor, "count").filter(|&count| count > 0)?);
    let mut copy = json!({});
    if let Some(target) = view.get("target").filter(|_| keeps_target) {
        copy["target"] = target.clone();
    }
    let Some(stride) = index(view, "byteStride") else {
        return Some((copy, bytes.get(..size.checked_mul(count)?)?.to_vec()));
    };
    let stride = Some(stride).filter(|&stride| stride >= size)?;
    let end = stride.checked_mul(count - 1)?.checked_add(size)?;
    bytes.get(..end)?;
    // Vertices begin at multiples of four bytes.
    let spacing = size.next_multiple_of(4);
    copy["byteStride"] = json!(spacing);
    let mut packed = vec![0; spacing * count];
    for (place, element) in packed.chunks_exact_mut(spacing).zip((0..count).map(|i| &bytes[stride * i..][..size])) {
        place[..size].copy_from_slice(element);
    }
    Some((copy, packed))
}

fn view_bytes<'a>(from: &'a Builder, view: &Value) -> Option<&'a [u8]> {
    let (start, length) = (index(view, "byteOffset").unwrap_or(0), index(view, "byteLength")?);
    from.bin.get(start..start.checked_add(length)?)
}

fn push_view(to: &mut Builder, mut view: Value, bytes: &[u8]) -> usize {
    view["buffer"] = json!(0);
    view["byteOffset"] = json!(append_aligned(&mut to.bin, bytes));
    view["byteLength"] = json!(bytes.len());
    to.push(Kind::BufferView, view)
}

/// Copies the bytes of a view that is used as a whole.
fn copy_view(from: &Builder, to: &mut Builder, view: &mut Value) -> Option<()> {
    let offset = append_aligned(&mut to.bin, view_bytes(from, view)?);
    view["buffer"] = json!(0);
    view["byteOffset"] = json!(offset);
    Some(())
}

/// Removes what changes no level.
fn strip(kind: Kind, object: &mut Value) {
    let primitives = object.get_mut("primitives").and_then(Value::as_array_mut);
    for primitive in primitives.into_iter().flatten().filter_map(Value::as_object_mut) {
        primitive.remove("extras");
        if let Some(extensions) = primitive.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.remove("KHR_materials_variants");
            if extensions.is_empty() {
                primitive.remove("extensions");
            }
        }
    }
    let Some(members) = object.as_object_mut() else { return };
    // Settings name materials, and so do reports.
    if kind != Kind::Material {
        members.remove("name");
    }
    // Morph targets are told by their names.
    let names = members.remove("extras").and_then(|mut extras| extras.get_mut("targetNames").map(Value::take));
    if let (Kind::Mesh, Some(names)) = (kind, names) {
        members.insert("extras".into(), json!({ "targetNames": names }));
    }
    match kind {
        Kind::BufferView => drop(members.remove("target")),
        Kind::Image if members.contains_key("bufferView") => drop(members.remove("uri")),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two vertices of positions in shorts and something else, in one view, and an image behind.
    fn interleaved(gap: usize) -> Builder {
        let mut out = Builder::new("test");
        out.bin.resize(gap, 9);
        for x in [1_u16, 2] {
            for value in [x, x, x, 77, 77, 77, 77, 77] {
                out.bin.extend(value.to_le_bytes());
            }
        }
        out.bin.extend(b"PNG!");
        out.push(Kind::BufferView, json!({ "buffer": 0, "byteOffset": gap, "byteLength": 32, "byteStride": 16 }));
        out.push(Kind::BufferView, json!({ "buffer": 0, "byteOffset": gap + 32, "byteLength": 4 }));
        out.push(Kind::Accessor, json!({ "bufferView": 0, "componentType": 5123, "count": 2, "type": "VEC3" }));
        out.push(Kind::Image, json!({ "bufferView": 1, "name": "an image" }));
        out.push(Kind::Texture, json!({ "source": 0 }));
        let base = json!({ "baseColorTexture": { "index": 0 } });
        out.push(Kind::Material, json!({ "name": "skin", "pbrMetallicRoughness": base, "extras": 1 }));
        let primitive = json!({ "attributes": { "POSITION": 0 }, "material": 0 });
        out.push(Kind::Mesh, json!({ "name": "a", "primitives": [primitive.clone(), primitive] }));
        out
    }

    #[test]
    fn a_copy_has_what_it_refers_to_once_and_nothing_else() {
        let (from, mut to) = (interleaved(8), Builder::new("test"));
        let mut copier = Copier::new(true);
        assert_eq!(copier.copy(&from, &mut to, Kind::Mesh, 0), Some(0));
        assert_eq!(copier.copy(&from, &mut to, Kind::Mesh, 0), Some(0));
        assert_eq!(copier.copy(&from, &mut to, Kind::Mesh, 1), None);
        let bytes: Vec<u8> = [1_u16, 1, 1, 0, 2, 2, 2, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(to.bin, [&bytes[..], b"PNG!"].concat());
        assert_eq!([Kind::Mesh, Kind::Accessor, Kind::BufferView, Kind::Image].map(|k| to.all(k).len()), [1, 1, 2, 1]);
        assert_eq!(to.all(Kind::Material)[0]["name"], "skin");
        assert!(to.all(Kind::Image)[0].get("name").is_none() && to.all(Kind::Material)[0].get("extras").is_none());
    }

    #[test]
    fn the_place_in_a_file_makes_no_difference() {
        let copy = |gap| {
            let mut to = Builder::new("test");
            Copier::new(true).copy(&interleaved(gap), &mut to, Kind::Mesh, 0);
            to.into_glb().expect("small")
        };
        assert_eq!(copy(0), copy(64));
    }

    #[test]
    fn a_view_that_is_too_short_is_no_copy() {
        let mut from = interleaved(0);
        from.bin.truncate(20);
        let mut to = Builder::new("test");
        Copier::new(true).copy(&from, &mut to, Kind::Mesh, 0);
        assert!(to.bin.is_empty() && to.all(Kind::BufferView).is_empty());
        assert_eq!(to.all(Kind::Accessor)[0]["bufferView"], 0, "the import refuses it");
    }
}
