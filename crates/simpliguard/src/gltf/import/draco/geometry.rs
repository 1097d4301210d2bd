//! One compressed geometry: bytes to indices and vertices.

use std::panic::{AssertUnwindSafe, catch_unwind};

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};

use crate::gltf::import::accessor::Component;

/// Vertex data starts at multiples of four bytes.
const VERTEX_ALIGNMENT: usize = 4;

/// An attribute to be read from the compressed bytes, in the type that its accessor declares.
pub(super) struct WantedAttribute<'a> {
    pub(super) name: &'a str,
    /// Its unique id in the compressed bytes.
    pub(super) id: u32,
    pub(super) component: Component,
    pub(super) normalized: bool,
}

/// Triangles and their vertices.
#[derive(Debug)]
pub(super) struct Geometry {
    pub(super) indices: Vec<u32>,
    pub(super) vertices: usize,
    /// In the order that they were asked for.
    pub(super) attributes: Vec<Attribute>,
}

/// The values of one attribute, a vertex after the other.
#[derive(Debug)]
pub(super) struct Attribute {
    pub(super) bytes: Vec<u8>,
    /// Bytes from one vertex to the next.
    pub(super) stride: usize,
    /// Type of the accessor.
    pub(super) shape: &'static str,
}

impl Geometry {
    /// Its size in bytes.
    pub(super) fn bytes(&self) -> u64 {
        let attributes: usize = self.attributes.iter().map(|attribute| attribute.bytes.len()).sum();
        (attributes + 4 * self.indices.len()) as u64
    }
}

/// Decodes `bytes`. The error says what was found.
pub(super) fn decode(bytes: &[u8], wanted: &[WantedAttribute<'_>], limits: DecodeLimits) -> Result<Geometry, String> {
    // The decoder reports broken bytes. Should one make it panic after all, the file fails, and not the program.
    catch_unwind(AssertUnwindSafe(|| read(bytes, wanted, limits)))
        .unwrap_or_else(|_| Err("its compressed bytes are broken".to_owned()))
}

fn read(bytes: &[u8], wanted: &[WantedAttribute<'_>], limits: DecodeLimits) -> Result<Geometry, String> {
    let mut mesh = Mesh::new();
    let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| error.to_string())?;
    let vertices = mesh.num_points();
    let mut most_bytes = limits.max_decoded_bytes;
    let mut attributes = Vec::with_capacity(wanted.len());
    for wanted in wanted {
        let source = mesh.attribute_by_unique_id(wanted.id);
        let source = source.ok_or_else(|| format!("it has no attribute {} for {}", wanted.id, wanted.name))?;
        let attribute = attribute(source, wanted, vertices, most_bytes)?;
        most_bytes = most_bytes.saturating_sub(attribute.bytes.len() as u64);
        attributes.push(attribute);
    }
    let indices = mesh.faces().iter().flatten().map(|point| point.0).collect();
    Ok(Geometry { indices, vertices, attributes })
}

/// The values of `source` for each vertex, in the type of `wanted`.
fn attribute(
    source: &PointAttribute,
    wanted: &WantedAttribute<'_>,
    vertices: usize,
    most_bytes: u64,
) -> Result<Attribute, String> {
    let components = usize::from(source.num_components());
    let shape = match components {
        1 => "SCALAR",
        2 => "VEC2",
        3 => "VEC3",
        4 => "VEC4",
        _ => return Err(format!("{} has {components} components", wanted.name)),
    };
    let stride = (components * wanted.component.size()).next_multiple_of(VERTEX_ALIGNMENT);
    let size = vertices.saturating_mul(stride);
    if size as u64 > most_bytes {
        return Err(format!("its {size} bytes of {} are over the limit", wanted.name));
    }
    let scale = scale(source, wanted);
    let (kind, source_stride) = (source.data_type(), components * source.data_type().byte_length());
    let data = source.buffer().data();
    let mut bytes = Vec::with_capacity(size);
    for vertex in 0..vertices {
        let at = (source.mapped_index(PointIndex(vertex as u32)).0 as usize).checked_mul(source_stride);
        let values = at.and_then(|at| data.get(at..)?.get(..source_stride));
        let values = values.ok_or_else(|| format!("it has too few values of {}", wanted.name))?;
        for value in values.chunks_exact(kind.byte_length()) {
            write(&mut bytes, wanted.component, number(kind, value) * scale);
        }
        bytes.resize((vertex + 1) * stride, 0);
    }
    Ok(Attribute { bytes, stride, shape })
}

/// The factor from stored values to those of the accessor, where one is a normalized integer and the other is not.
fn scale(source: &PointAttribute, wanted: &WantedAttribute<'_>) -> f64 {
    let is_float = |kind| matches!(kind, DataType::Float32 | DataType::Float64);
    match (is_float(source.data_type()), wanted.component) {
        (false, Component::F32) if source.normalized() => 1.0 / largest(source.data_type()),
        (true, Component::I8) if wanted.normalized => f64::from(i8::MAX),
        (true, Component::U8) if wanted.normalized => f64::from(u8::MAX),
        (true, Component::I16) if wanted.normalized => f64::from(i16::MAX),
        (true, Component::U16) if wanted.normalized => f64::from(u16::MAX),
        _ => 1.0,
    }
}

/// The largest value of an integer type.
fn largest(kind: DataType) -> f64 {
    match kind {
        DataType::Int8 => f64::from(i8::MAX),
        DataType::Uint8 => f64::from(u8::MAX),
        DataType::Int16 => f64::from(i16::MAX),
        DataType::Uint16 => f64::from(u16::MAX),
        DataType::Int32 => f64::from(i32::MAX),
        DataType::Uint32 => f64::from(u32::MAX),
        _ => 1.0,
    }
}

/// The number in `bytes`, which has the length of its type.
fn number(kind: DataType, bytes: &[u8]) -> f64 {
    fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
        std::array::from_fn(|k| bytes.get(k).copied().unwrap_or_default())
    }
    match kind {
        DataType::Int8 => f64::from(i8::from_le_bytes(array(bytes))),
        DataType::Uint8 | DataType::Bool => f64::from(u8::from_le_bytes(array(bytes))),
        DataType::Int16 => f64::from(i16::from_le_bytes(array(bytes))),
        DataType::Uint16 => f64::from(u16::from_le_bytes(array(bytes))),
        DataType::Int32 => f64::from(i32::from_le_bytes(array(bytes))),
        DataType::Uint32 => f64::from(u32::from_le_bytes(array(bytes))),
        DataType::Int64 => i64::from_le_bytes(array(bytes)) as f64,
        DataType::Uint64 => u64::from_le_bytes(array(bytes)) as f64,
        DataType::Float32 => f64::from(f32::from_le_bytes(array(bytes))),
        DataType::Float64 => f64::from_le_bytes(array(bytes)),
        DataType::Invalid => 0.0,
    }
}

/// Appends `value`, rounded and clamped to the range of an integer type.
fn write(out: &mut Vec<u8>, component: Component, value: f64) {
    match component {
        Component::F32 => out.extend((value as f32).to_le_bytes()),
        Component::I8 => out.extend((value.round() as i8).to_le_bytes()),
        Component::U8 => out.extend((value.round() as u8).to_le_bytes()),
        Component::I16 => out.extend((value.round() as i16).to_le_bytes()),
        Component::U16 => out.extend((value.round() as u16).to_le_bytes()),
        Component::U32 => out.extend((value.round() as u32).to_le_bytes()),
    }
}
