// Types, bindings and helpers of all kernels. Each kernel uses at most eight of the storage bindings.
//
// Sums over pixels are gathered in a fixed order or made of integers, so that they do not depend on the scheduling.

const EMPTY_PIXEL: u32 = 0xffffffffu;
const NO_NEIGHBOUR: u32 = 0xffffffffu;
const NO_EDGE: u32 = 0xffffffffu;
const TILE: u32 = 16u;

struct Params {
    // First column and row, and one past the last ones, of the pixels that the mesh or the source may touch.
    rect: vec4<u32>,
    // The first tile, and the tiles in a row.
    first_tile: vec2<u32>,
    tiles_in_row: u32,
    double_sided: u32,
    // Sides of the view in pixels and of the texture in texels.
    size: u32,
    texture_size: u32,
    vertices: u32,
    triangles: u32,
    background: f32,
    gradient_weight: f32,
    smoothness: f32,
    // Where the partial sums of this view begin.
    first_partial: u32,
    // Every so many-th row and column of pixels counts in the texture, each pixel with a weight from 0 to 1.
    pixel_stride: u32,
    pixel_weight: f32,
    // Side of the coarse texture, zero without one, and the error at which a pixel counts half.
    coarse_size: u32,
    trust: f32,
}

struct Triangle {
    vertices: array<u32, 3>,
    neighbours: array<u32, 3>,
    // Texture coordinates of the corners, in texels.
    uvs: array<vec2<f32>, 3>,
}

struct Vertex {
    clip: vec4<f32>,
    // Position in pixels, and depth.
    pixel: vec4<f32>,
}

// A triangle set up for scan conversion and for lookups.
struct Setup {
    // Corners in pixels, from the lowest to the highest.
    low: vec2<f32>,
    middle: vec2<f32>,
    high: vec2<f32>,
    is_drawn: u32,
    is_facing: u32,
    // The depth at pixel (x, y) is plane.x + plane.y * x + plane.z * y.
    plane: vec4<f32>,
    // Homogeneous barycentric coefficients.
    k0: vec4<f32>,
    k1: vec4<f32>,
    k2: vec4<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> triangles: array<Triangle>;
@group(0) @binding(2) var<storage, read_write> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read_write> setups: array<Setup>;
@group(0) @binding(4) var<storage, read_write> ids: array<u32>;
@group(0) @binding(5) var<storage, read_write> depth: array<f32>;
@group(0) @binding(6) var<storage, read_write> texels: array<vec4<f32>>;
// Colours before antialiasing.
@group(0) @binding(7) var<storage, read_write> base: array<vec4<f32>>;
// The blends of each pixel that lies within a silhouette, one for each direction: how far the silhouette reaches towards
// the next pixel, and the half-edge that is its outermost.
@group(0) @binding(8) var<storage, read_write> reach: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> edges: array<atomic<u32>>;
// The view of the source.
@group(0) @binding(10) var<storage, read_write> source_view: array<u32>;
// Colours after antialiasing.
@group(0) @binding(11) var<storage, read_write> image: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> residual: array<vec4<f32>>;
// At the pixels after antialiasing, and before it.
@group(0) @binding(13) var<storage, read_write> image_gradient: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> base_gradient: array<vec4<f32>>;
// In clip space (x, y, w), at each corner of each triangle, and at both ends of each half-edge.
@group(0) @binding(15) var<storage, read_write> corner_gradients: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> end_gradients: array<vec4<f32>>;
// Where the corners of each vertex begin, then the corners.
@group(0) @binding(17) var<storage, read_write> incidence: array<u32>;
@group(0) @binding(18) var<storage, read_write> vertex_gradients: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read_write> partials: array<vec4<f32>>;

fn pixel_of(group: vec3<u32>, local: vec3<u32>) -> vec2<u32> {
    return (params.first_tile + group.xy) * TILE + local.xy;
}

fn is_within(pixel: vec2<u32>) -> bool {
    return pixel.x >= params.rect.x && pixel.y >= params.rect.y && pixel.x < params.rect.z && pixel.y < params.rect.w;
}

fn index_of(pixel: vec2<u32>) -> u32 {
    return pixel.y * params.size + pixel.x;
}

// Index over a grid of workgroups with more than one row.
fn linear(group: vec3<u32>, groups: vec3<u32>, per_group: u32, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * per_group + local;
}

fn ndc_of(pixel: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(2u * pixel + 1u) / f32(params.size) - 1.0;
}

fn cross_2d(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

var<workgroup> sums: array<vec4<f32>, 256>;

// The sum over a workgroup of 256, in a fixed order.
fn sum_of_group(value: vec4<f32>, local: u32) -> vec4<f32> {
    sums[local] = value;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half = half / 2u) {
        if local < half {
            sums[local] += sums[local + half];
        }
        workgroupBarrier();
    }
    return sums[0];
}

// A bilinear texture lookup: its first texel, and the fractions towards the next column and row.
struct Lookup {
    texel: u32,
    x: f32,
    y: f32,
}

fn lookup_at(uv: vec2<f32>, size: u32) -> Lookup {
    let last = f32(size) - 1.001;
    let at = clamp(uv - 0.5, vec2<f32>(0.0), vec2<f32>(last));
    let whole = vec2<u32>(at);
    return Lookup(whole.y * size + whole.x, at.x - f32(whole.x), at.y - f32(whole.y));
}

fn weights_of(lookup: Lookup) -> vec4<f32> {
    let x = lookup.x;
    let y = lookup.y;
    return vec4<f32>((1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y);
}

// Perspective-correct barycentric coordinates, and the inverse of the sum of the homogeneous ones.
fn barycentric_at(setup: Setup, ndc: vec2<f32>) -> vec4<f32> {
    let at = vec3<f32>(1.0, ndc.x, ndc.y);
    let a = vec3<f32>(dot(setup.k0.xyz, at), dot(setup.k1.xyz, at), dot(setup.k2.xyz, at));
    let inverse = 1.0 / (a.x + a.y + a.z);
    return vec4<f32>(a * inverse, inverse);
}

fn uv_at(triangle: u32, barycentric: vec3<f32>) -> vec2<f32> {
    let uvs = triangles[triangle].uvs;
    return uvs[0] * barycentric.x + uvs[1] * barycentric.y + uvs[2] * barycentric.z;
}
