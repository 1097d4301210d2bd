// The texture that fits all views best. Mirrors refine/texture_least_squares.

// Of the squared change from the initial texture, in pixels.
const PRIOR: f32 = 0.01;
// One, in the fixed point numbers of the sums over pixels.
const ONE: f32 = 16777216.0;
const TOLERANCE: f32 = 1e-3;

// Sums over pixels: eight numbers of 64 bits for each texel, low word first. They are those of `Row`.
@group(0) @binding(21) var<storage, read_write> pixel_sums: array<atomic<u32>>;
// Nonzero for texels that some triangle covers.
@group(0) @binding(22) var<storage, read_write> covered: array<u32>;

// Coupling of a texel with itself, the texel to the right, below and below right; then the right-hand side, and the
// coupling with the texel below left.
struct Row {
    a: vec4<f32>,
    b: vec4<f32>,
}

@group(0) @binding(23) var<storage, read_write> rows: array<Row>;
@group(0) @binding(24) var<storage, read_write> solution: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> remainder: array<vec4<f32>>;
@group(0) @binding(26) var<storage, read_write> scaled: array<vec4<f32>>;
@group(0) @binding(27) var<storage, read_write> heading: array<vec4<f32>>;
@group(0) @binding(28) var<storage, read_write> product: array<vec4<f32>>;

struct Iteration {
    energy: vec4<f32>,
    // Step length, and factor on the last direction.
    length: vec4<f32>,
    factor: vec4<f32>,
    stop: f32,
}

@group(0) @binding(29) var<storage, read_write> iteration: Iteration;

// A first solution of half the side: its texels, then how much each of them has changed.
@group(0) @binding(30) var<storage, read_write> coarse: array<vec4<f32>>;

fn texel_count() -> u32 {
    return params.texture_size * params.texture_size;
}

@compute @workgroup_size(256)
fn clear_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    if i < texel_count() {
        for (var k = 16u * i; k < 16u * i + 16u; k++) {
            atomicStore(&pixel_sums[k], 0u);
        }
    }
}

// Adds a number from 0 to 1. Integers add up alike in any order.
fn add_term(texel: u32, slot: u32, value: f32) {
    let k = 16u * texel + 2u * slot;
    let add = u32(value * ONE + 0.5);
    if atomicAdd(&pixel_sums[k], add) > 0xffffffffu - add {
        atomicAdd(&pixel_sums[k + 1u], 1u);
    }
}

fn add_right_side(texel: u32, color: vec3<f32>) {
    add_term(texel, 5u, color.r);
    add_term(texel, 6u, color.g);
    add_term(texel, 7u, color.b);
}

fn is_on_silhouette(pixel: vec2<u32>) -> bool {
    let i = index_of(pixel);
    for (var direction = 0u; direction < 4u; direction++) {
        let next = neighbour(pixel, direction);
        if next.exists && (blend_of(i, direction).exists || blend_of(next.index, opposite(direction)).exists) {
            return true;
        }
    }
    return false;
}

// The coarse texture at texture coordinates of the fine one; or, from `first` on, how it has changed.
fn coarse_at(uv: vec2<f32>, first: u32) -> vec3<f32> {
    let lookup = lookup_at(uv * 0.5, params.coarse_size);
    let weights = weights_of(lookup);
    let k = first + lookup.texel;
    let color = coarse[k] * weights.x
        + coarse[k + 1u] * weights.y
        + coarse[k + params.coarse_size] * weights.z
        + coarse[k + params.coarse_size + 1u] * weights.w;
    return color.rgb;
}

// How much a pixel of this colour counts, by how well it agrees with the coarse texture.
fn pixel_weight_of(uv: vec2<f32>, color: vec3<f32>) -> f32 {
    if params.coarse_size == 0u {
        return params.pixel_weight;
    }
    let error = coarse_at(uv, 0u) - color;
    return params.pixel_weight / (1.0 + dot(error, error) / (params.trust * params.trust));
}

// Adds the pixels of a view that lie wholly on the source and on the level.
@compute @workgroup_size(16, 16)
fn assemble(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) || any((pixel - params.rect.xy) % params.pixel_stride != vec2<u32>(0u)) {
        return;
    }
    let i = index_of(pixel);
    let id = ids[i];
    let packed = source_view[i];
    if id == EMPTY_PIXEL || packed >> 24u != 255u || is_on_silhouette(pixel) {
        return;
    }
    let color = unpack4x8unorm(packed).rgb;
    let uv = uv_at(id, barycentric_at(setups[id], ndc_of(pixel)).xyz);
    let weight = pixel_weight_of(uv, color);
    let lookup = lookup_at(uv, params.texture_size);
    let w = weights_of(lookup);
    let weighted = w * weight;
    let first = lookup.texel;
    let right = first + 1u;
    let below = first + params.texture_size;
    let below_right = below + 1u;
    add_term(first, 0u, weighted.x * w.x);
    add_term(first, 1u, weighted.x * w.y);
    add_term(first, 2u, weighted.x * w.z);
    add_term(first, 3u, weighted.x * w.w);
    add_right_side(first, color * weighted.x);
    add_term(right, 0u, weighted.y * w.y);
    add_term(right, 2u, weighted.y * w.w);
    add_term(right, 4u, weighted.y * w.z);
    add_right_side(right, color * weighted.y);
    add_term(below, 0u, weighted.z * w.z);
    add_term(below, 1u, weighted.z * w.w);
    add_right_side(below, color * weighted.z);
    add_term(below_right, 0u, weighted.w * w.w);
    add_right_side(below_right, color * weighted.w);
}

fn sum_at(texel: u32, slot: u32) -> f32 {
    let k = 16u * texel + 2u * slot;
    return f32(atomicLoad(&pixel_sums[k + 1u])) * (4294967296.0 / ONE) + f32(atomicLoad(&pixel_sums[k])) / ONE;
}

// The row of each texel, with the prior and the smoothness. The fourth slot of the solution tells whether a view sees it.
@compute @workgroup_size(256)
fn regularise(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    if i >= texel_count() {
        return;
    }
    let size = params.texture_size;
    let own = texels[i].rgb;
    var start = own;
    if params.coarse_size != 0u {
        start += coarse_at(vec2<f32>(vec2<u32>(i % size, i / size)) + 0.5, params.coarse_size * params.coarse_size);
    }
    var a = vec4<f32>(sum_at(i, 0u), sum_at(i, 1u), sum_at(i, 2u), sum_at(i, 3u));
    var b = vec3<f32>(sum_at(i, 5u), sum_at(i, 6u), sum_at(i, 7u));
    solution[i] = vec4<f32>(start, select(0.0, 1.0, a.x > 0.0));
    a.x += PRIOR;
    b += PRIOR * own;
    if covered[i] != 0u {
        let x = i % size;
        let y = i / size;
        if x + 1u < size && covered[i + 1u] != 0u {
            a.y -= params.smoothness;
            a.x += params.smoothness;
            b += (own - texels[i + 1u].rgb) * params.smoothness;
        }
        if y + 1u < size && covered[i + size] != 0u {
            a.z -= params.smoothness;
            a.x += params.smoothness;
            b += (own - texels[i + size].rgb) * params.smoothness;
        }
        if x > 0u && covered[i - 1u] != 0u {
            a.x += params.smoothness;
            b += (own - texels[i - 1u].rgb) * params.smoothness;
        }
        if y > 0u && covered[i - size] != 0u {
            a.x += params.smoothness;
            b += (own - texels[i - size].rgb) * params.smoothness;
        }
    }
    rows[i] = Row(a, vec4<f32>(b, sum_at(i, 4u)));
    heading[i] = vec4<f32>(start, 0.0);
}

// The row of texel `i` times the heading. Couplings across the texture's border are zero.
fn row_times_heading(i: u32) -> vec4<f32> {
    let size = params.texture_size;
    let texel_end = texel_count();
    let row = rows[i];
    var sum = heading[i] * row.a.x;
    if i + 1u < texel_end {
        sum += heading[i + 1u] * row.a.y;
    }
    if i + size < texel_end {
        sum += heading[i + size] * row.a.z;
    }
    if i + size + 1u < texel_end {
        sum += heading[i + size + 1u] * row.a.w;
    }
    if i + size - 1u < texel_end {
        sum += heading[i + size - 1u] * row.b.w;
    }
    if i >= 1u {
        sum += heading[i - 1u] * rows[i - 1u].a.y;
    }
    if i >= size {
        sum += heading[i - size] * rows[i - size].a.z;
    }
    if i >= size + 1u {
        sum += heading[i - size - 1u] * rows[i - size - 1u].a.w;
    }
    if i >= size - 1u {
        sum += heading[i - size + 1u] * rows[i - size + 1u].b.w;
    }
    return sum;
}

// The first residual. The heading is the solution at the start.
@compute @workgroup_size(256)
fn begin_descent(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    var energy = vec4<f32>(0.0);
    if i < texel_count() {
        let row = rows[i];
        let left = vec4<f32>(row.b.xyz - row_times_heading(i).xyz, 0.0);
        remainder[i] = left;
        scaled[i] = left / row.a.x;
        energy = left * left / row.a.x;
    }
    store_partial(energy, local, linear(group, groups, 1u, 0u));
}

fn store_partial(value: vec4<f32>, local: u32, group: u32) {
    let sum = sum_of_group(value, local);
    if local == 0u {
        partials[group] = sum;
    }
}

@compute @workgroup_size(256)
fn multiply(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    var curvature = vec4<f32>(0.0);
    if i < texel_count() {
        let times = row_times_heading(i);
        product[i] = times;
        curvature = heading[i] * times;
    }
    store_partial(curvature, local, linear(group, groups, 1u, 0u));
}

@compute @workgroup_size(256)
fn step_solution(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    var energy = vec4<f32>(0.0);
    if i < texel_count() {
        let length = iteration.length;
        solution[i] += heading[i] * length;
        let left = remainder[i] - product[i] * length;
        remainder[i] = left;
        scaled[i] = left / rows[i].a.x;
        energy = left * left / rows[i].a.x;
    }
    store_partial(energy, local, linear(group, groups, 1u, 0u));
}

@compute @workgroup_size(256)
fn turn(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups, 256u, local);
    if i < texel_count() {
        heading[i] = scaled[i] + heading[i] * iteration.factor;
    }
}

fn sum_of_partials(local: u32) -> vec4<f32> {
    let count_of_partials = (texel_count() + 255u) / 256u;
    var sum = vec4<f32>(0.0);
    for (var i = local; i < count_of_partials; i += 256u) {
        sum += partials[i];
    }
    return sum_of_group(sum, local);
}

@compute @workgroup_size(256)
fn first_energy(@builtin(local_invocation_index) local: u32) {
    let energy = sum_of_partials(local);
    if local == 0u {
        iteration.energy = energy;
        iteration.stop = dot(energy, vec4<f32>(1.0)) * TOLERANCE * TOLERANCE;
        iteration.factor = vec4<f32>(0.0);
    }
}

// The length of the next step, from the curvature along it. It is zero once the residual is small enough.
@compute @workgroup_size(256)
fn step_length(@builtin(local_invocation_index) local: u32) {
    let curvature = sum_of_partials(local);
    if local == 0u {
        let energy = iteration.energy;
        let is_done = dot(energy, vec4<f32>(1.0)) <= iteration.stop;
        let goes_on = (curvature > vec4<f32>(1e-20)) & vec4<bool>(!is_done);
        iteration.length = select(vec4<f32>(0.0), energy / curvature, goes_on);
    }
}

// The factor on the last direction, from the energy after the step.
@compute @workgroup_size(256)
fn next_factor(@builtin(local_invocation_index) local: u32) {
    let next = sum_of_partials(local);
    if local == 0u {
        let energy = iteration.energy;
        iteration.factor = select(vec4<f32>(0.0), next / energy, energy > vec4<f32>(1e-30));
        iteration.energy = next;
    }
}
