//! Placeholders of meshes and images.

use image::{Rgba, RgbaImage};
use serde_json::{Value, json};

use crate::gltf::export::builder::{BufferTarget, Builder, Kind, index};
use crate::gltf::png::png;

/// Vertices of a placeholder.
const VERTICES: usize = 3;
/// Component types of glTF.
const U8: u64 = 5121;
const U16: u64 = 5123;
const F32: u64 = 5126;
/// Modes of primitives of triangles: lists, strips and fans.
const TRIANGLES: std::ops::RangeInclusive<u64> = 4..=6;

/// Tells whether a mesh can have a placeholder: if it has triangles alone, its box is known, and nothing is encoded.
pub(super) fn can_replace_mesh(file: &Builder, mesh: usize) -> bool {
    let primitives = primitives(file, mesh);
    !primitives.is_empty() && primitives.iter().all(|primitive| corners(file, primitive).is_some())
}

/// Puts a placeholder in place of a mesh: for each primitive, a triangle without area between the corners of its box. It has
/// the attributes and morph targets of the primitive, so that renderers draw both alike.
pub(super) fn replace_mesh(file: &mut Builder, mesh: usize) {
    for i in 0..primitives(file, mesh).len() {
        let mut primitive = primitives(file, mesh)[i].clone();
        let Some(corners) = corners(file, &primitive) else { continue };
        let all = ["/attributes".to_owned()].into_iter();
        let targets = primitive.get("targets").and_then(Value::as_array).map_or(0, Vec::len);
        for path in all.chain((0..targets).map(|target| format!("/targets/{target}"))) {
            let corners = (path == "/attributes").then_some(&corners);
            let Some(attributes) = primitive.pointer_mut(&path).and_then(Value::as_object_mut) else { continue };
            for (name, accessor) in attributes {
                let old = accessor.as_u64().and_then(|i| file.all(Kind::Accessor).get(i as usize)).cloned();
                *accessor = json!(push_attribute(file, name, &old.unwrap_or_default(), corners));
            }
        }
        if primitive.get("indices").is_some() {
            let view = file.push_view(&[0_u16, 1, 2].map(u16::to_le_bytes).concat(), BufferTarget::Indices);
            let accessor = json!({ "bufferView": view, "componentType": U16, "count": VERTICES, "type": "SCALAR" });
            primitive["indices"] = json!(file.push(Kind::Accessor, accessor));
        }
        file.all_mut(Kind::Mesh)[mesh]["primitives"][i] = primitive;
    }
}

/// Puts an image of one texel in place of an image.
pub(super) fn replace_image(file: &mut Builder, image: usize) {
    let pixel = png(&RgbaImage::from_pixel(1, 1, Rgba([u8::MAX; 4]))).unwrap_or_default();
    let view = file.push_view(&pixel, BufferTarget::None);
    let Some(object) = file.all_mut(Kind::Image).get_mut(image) else { return };
    (object["bufferView"], object["mimeType"]) = (json!(view), json!("image/png"));
    if let Some(extras) = object.get_mut("extras").and_then(Value::as_object_mut) {
        extras.remove("simpliguard");
    }
}

fn primitives(file: &Builder, mesh: usize) -> &[Value] {
    let mesh = file.all(Kind::Mesh).get(mesh);
    mesh.and_then(|mesh| mesh.get("primitives")).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// The least and the greatest corner of the box of a primitive.
fn corners(file: &Builder, primitive: &Value) -> Option<[Value; 2]> {
    let extensions = primitive.get("extensions").and_then(Value::as_object);
    let is_encoded = extensions.is_some_and(|all| all.contains_key("KHR_draco_mesh_compression"));
    let position = file.all(Kind::Accessor).get(index(primitive.get("attributes")?, "POSITION")?)?;
    let has_triangles = primitive.get("mode").and_then(Value::as_u64).is_none_or(|mode| TRIANGLES.contains(&mode));
    let is_float = position.get("componentType").and_then(Value::as_u64) == Some(F32);
    let corner = |name| position.get(name).filter(|corner| corner.as_array().is_some_and(|all| all.len() == 3));
    (has_triangles && is_float && !is_encoded).then_some([corner("min")?.clone(), corner("max")?.clone()])
}

/// An accessor of three vertices with the type of an `old` one.
fn push_attribute(file: &mut Builder, name: &str, old: &Value, corners: Option<&[Value; 2]>) -> usize {
    let component = old.get("componentType").and_then(Value::as_u64).unwrap_or(F32);
    let shape = old.get("type").and_then(Value::as_str).unwrap_or("SCALAR");
    let mut accessor = json!({ "componentType": component, "count": VERTICES, "type": shape });
    if let Some(normalized) = old.get("normalized") {
        accessor["normalized"] = normalized.clone();
    }
    let mut bytes = vertex(name, component, shape).repeat(VERTICES);
    if let Some([least, greatest]) = corners.filter(|_| name == "POSITION") {
        (accessor["min"], accessor["max"]) = (least.clone(), greatest.clone());
        let all = [least, greatest, least].into_iter().flat_map(|corner| corner.as_array().into_iter().flatten());
        bytes = all.flat_map(|number| (number.as_f64().unwrap_or(0.0) as f32).to_le_bytes()).collect();
    } else if name == "POSITION" {
        (accessor["min"], accessor["max"]) = (json!([0, 0, 0]), json!([0, 0, 0]));
    }
    accessor["bufferView"] = json!(file.push_view(&bytes, BufferTarget::Vertices));
    file.push(Kind::Accessor, accessor)
}

/// The bytes of an attribute of a vertex. A normal has a length, and weights a sum of one.
fn vertex(name: &str, component: u64, shape: &str) -> Vec<u8> {
    let one = match component {
        F32 => 1.0_f32.to_le_bytes().to_vec(),
        U16 | 5122 => u16::MAX.to_le_bytes().to_vec(),
        U8 | 5120 => vec![u8::MAX],
        _ => 1_u32.to_le_bytes().to_vec(),
    };
    let numbers = match shape {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        _ => 4,
    };
    let is_one = |i: usize| match name {
        "NORMAL" => i == 2,
        "WEIGHTS_0" | "TANGENT" => i == 0 || name == "TANGENT" && i == 3,
        _ => false,
    };
    (0..numbers).flat_map(|i| if is_one(i) { one.clone() } else { vec![0; one.len()] }).collect()
}
