//! One mesh primitive in its own space, with only the vertices its triangles use.

use glam::{Vec2, Vec3, Vec4};

use super::accessor::Reader;
use super::influences::{has_joints, influences};
use super::primitive_mesh::{PrimitiveMesh, renumber};
use super::schema;
use crate::Error;
use crate::data::{Influences, area_vector};
use crate::geometry::{first_equal, position_bits};

const TRIANGLES: u32 = 4;
const TRIANGLE_STRIP: u32 = 5;
const TRIANGLE_FAN: u32 = 6;

/// True if a primitive is made of triangles with positions.
pub(super) fn has_triangles(primitive: &schema::Primitive<'_>) -> bool {
    let mode = primitive.mode.unwrap_or(TRIANGLES);
    matches!(mode, TRIANGLES | TRIANGLE_STRIP | TRIANGLE_FAN) && primitive.attributes.contains_key("POSITION")
}

/// Number of triangles, from the accessors' counts alone.
pub(super) fn triangle_count(reader: Reader<'_>, primitive: &schema::Primitive<'_>) -> Result<usize, Error> {
    if !has_triangles(primitive) {
        return Ok(0);
    }
    let corners = corner_count(reader, primitive)?;
    Ok(if primitive.mode.unwrap_or(TRIANGLES) == TRIANGLES { corners / 3 } else { corners.saturating_sub(2) })
}

/// Reads `primitive`, with its morph targets applied at `weights`, and with their displacements if
/// `with_displacements`. `uv_sets` are the `TEXCOORD_n` that become the surface's two sets.
pub(super) fn read(
    reader: Reader<'_>,
    primitive: &schema::Primitive<'_>,
    weights: &[f32],
    with_displacements: bool,
    uv_sets: [usize; 2],
) -> Result<PrimitiveMesh, Error> {
    let mut triangles = triangles(reader, primitive)?;
    let used = renumber(&mut triangles, vertex_count(reader, primitive)?);
    let attributes = Attributes { reader, primitive, weights, used: &used };
    let positions: Vec<Vec3> = attributes.morphed("POSITION")?.unwrap_or_default();
    let normals: Option<Vec<Vec3>> = attributes.morphed("NORMAL")?;
    reader.asset.check()?;
    let is_flat = normals.is_none();
    let mesh = PrimitiveMesh {
        normals: completed_normals(normals, &positions, &triangles),
        positions,
        tangents: attributes.tangents()?,
        uvs: [attributes.uvs(uv_sets[0])?, attributes.uvs(uv_sets[1])?],
        colors: attributes.colors("COLOR_0")?,
        painted: attributes.colors("COLOR_1")?.map(|colors| colors.iter().map(|c| c.x.min(1.0)).collect()),
        influences: attributes.influences()?,
        displacements: if with_displacements { attributes.displacements()? } else { Vec::new() },
        double_sided: primitive.material.and_then(|m| reader.root.materials.get(m)).is_some_and(|m| m.double_sided),
        triangles,
    };
    reader.asset.check()?;
    Ok(match primitive.indices {
        _ if is_flat => mesh.with_flat_normals(),
        None => mesh.with_merged_vertices(),
        Some(_) => mesh,
    })
}

fn vertex_count(reader: Reader<'_>, primitive: &schema::Primitive<'_>) -> Result<usize, Error> {
    primitive.attributes.get("POSITION").map_or(Ok(0), |&accessor| reader.count(accessor))
}

fn corner_count(reader: Reader<'_>, primitive: &schema::Primitive<'_>) -> Result<usize, Error> {
    primitive.indices.map_or_else(|| vertex_count(reader, primitive), |accessor| reader.count(accessor))
}

/// Triangles with the primitive's own vertex numbers, checked against the number of vertices.
fn triangles(reader: Reader<'_>, primitive: &schema::Primitive<'_>) -> Result<Vec<[u32; 3]>, Error> {
    let (corners, vertices) = (corner_count(reader, primitive)? as u32, vertex_count(reader, primitive)?);
    let corners: Vec<u32> = match primitive.indices {
        Some(accessor) => reader.integers::<1>(accessor, 0..corners)?.into_iter().map(|[vertex]| vertex).collect(),
        None => (0..corners).collect(),
    };
    if let Some(vertex) = corners.iter().find(|&&vertex| vertex as usize >= vertices) {
        return Err(reader.asset.invalid(format!("an index names vertex {vertex} of a primitive that has {vertices}")));
    }
    Ok(match primitive.mode.unwrap_or(TRIANGLES) {
        TRIANGLE_STRIP => {
            let corner = |i: usize, k: usize| corners[i + k];
            let triangle = |i| if i % 2 == 0 { [0, 1, 2] } else { [0, 2, 1] }.map(|k| corner(i, k));
            (0..corners.len().saturating_sub(2)).map(triangle).collect()
        }
        TRIANGLE_FAN => corners.get(1..).unwrap_or_default().windows(2).map(|w| [w[0], w[1], corners[0]]).collect(),
        _ => corners.as_chunks::<3>().0.to_vec(),
    })
}

/// Reads the attributes of the used vertices.
struct Attributes<'a> {
    reader: Reader<'a>,
    primitive: &'a schema::Primitive<'a>,
    weights: &'a [f32],
    used: &'a [u32],
}

impl Attributes<'_> {
    fn accessor(&self, name: &str) -> Option<usize> {
        self.primitive.attributes.get(name).copied()
    }

    fn at(&self) -> impl Iterator<Item = u32> {
        self.used.iter().copied()
    }

    /// A `VEC3` attribute with its morph targets added.
    fn morphed(&self, name: &str) -> Result<Option<Vec<Vec3>>, Error> {
        let Some(accessor) = self.accessor(name) else { return Ok(None) };
        let mut values: Vec<Vec3> = self.reader.floats(accessor, self.at())?.into_iter().map(Vec3::from).collect();
        self.morph(name, |vertex, offset| values[vertex] += offset)?;
        Ok(Some(values))
    }

    fn morph(&self, name: &str, mut add: impl FnMut(usize, Vec3)) -> Result<(), Error> {
        for (&weight, target) in self.weights.iter().zip(&self.primitive.targets) {
            let Some(&accessor) = target.get(name).filter(|_| weight != 0.0) else { continue };
            for (vertex, offset) in self.reader.floats(accessor, self.at())?.into_iter().enumerate() {
                add(vertex, Vec3::from_array(offset) * weight);
            }
        }
        Ok(())
    }

    /// The displacements of each morph target.
    fn displacements(&self) -> Result<Vec<Vec<Vec3>>, Error> {
        let target = |target: &std::collections::BTreeMap<&str, usize>| match target.get("POSITION") {
            Some(&accessor) => Ok(self.reader.floats(accessor, self.at())?.into_iter().map(Vec3::from).collect()),
            None => Ok(Vec::new()),
        };
        self.primitive.targets.iter().map(target).collect()
    }

    fn tangents(&self) -> Result<Option<Vec<Vec4>>, Error> {
        let Some(accessor) = self.accessor("TANGENT") else { return Ok(None) };
        let mut values: Vec<Vec4> = self.reader.floats(accessor, self.at())?.into_iter().map(Vec4::from).collect();
        self.morph("TANGENT", |vertex, offset| values[vertex] += offset.extend(0.0))?;
        Ok(Some(values))
    }

    fn uvs(&self, set: usize) -> Result<Option<Vec<Vec2>>, Error> {
        let Some(accessor) = self.accessor(&format!("TEXCOORD_{set}")) else { return Ok(None) };
        let finite = |uv| Some(Vec2::from_array(uv)).filter(|uv| uv.is_finite()).unwrap_or_default();
        Ok(Some(self.reader.floats(accessor, self.at())?.into_iter().map(finite).collect()))
    }

    /// Linear RGBA; a colour without alpha is opaque.
    fn colors(&self, name: &str) -> Result<Option<Vec<Vec4>>, Error> {
        let Some(accessor) = self.accessor(name) else { return Ok(None) };
        let colors: Vec<Vec4> = if self.reader.components(accessor)? == 3 {
            self.reader.normalized(accessor, self.at())?.into_iter().map(|c| Vec3::from_array(c).extend(1.0)).collect()
        } else {
            self.reader.normalized(accessor, self.at())?.into_iter().map(Vec4::from).collect()
        };
        let sound = |c: Vec4| if c.is_finite() { c.max(Vec4::ZERO) } else { Vec4::ONE };
        Ok(Some(colors.into_iter().map(sound).collect()))
    }

    /// The four joints of largest weight over all `JOINTS_n` and `WEIGHTS_n`.
    fn influences(&self) -> Result<Option<Vec<Influences>>, Error> {
        if !has_joints(self.primitive) {
            return Ok(None);
        }
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        for set in 0.. {
            let names = [format!("JOINTS_{set}"), format!("WEIGHTS_{set}")];
            let [Some(j), Some(w)] = names.map(|name| self.accessor(&name)) else { break };
            joints.push(self.reader.integers::<4>(j, self.at())?);
            weights.push(self.reader.normalized::<4>(w, self.at())?);
        }
        let of_vertex = |vertex: usize| {
            let set = |s: usize| (0..4).map(move |k| (s, k));
            let pairs = (0..joints.len())
                .flat_map(set)
                .filter_map(|(s, k)| Some((u16::try_from(joints[s][vertex][k]).ok()?, weights[s][vertex][k])));
            influences(pairs).unwrap_or_default()
        };
        Ok(Some((0..self.used.len()).map(of_vertex).collect()))
    }
}

/// The given normals at unit length. Zero normals become the area-weighted mean of the faces around the position. Without
/// any, all are zero.
fn completed_normals(given: Option<Vec<Vec3>>, positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let unit = |normal: Vec3| normal.try_normalize().unwrap_or_default();
    let Some(given) = given else { return vec![Vec3::ZERO; positions.len()] };
    let mut normals: Vec<Vec3> = given.into_iter().map(unit).collect();
    if normals.iter().all(|&normal| normal != Vec3::ZERO) {
        return normals;
    }
    let welded = first_equal(positions.len(), |vertex| position_bits(positions[vertex]));
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let area = area_vector(triangle.map(|v| positions[v as usize]));
        if area.is_finite() {
            triangle.iter().for_each(|&v| sums[welded[v as usize] as usize] += area);
        }
    }
    for (normal, &first) in normals.iter_mut().zip(&welded) {
        if *normal == Vec3::ZERO {
            *normal = unit(sums[first as usize]);
        }
    }
    normals
}
