// The image loss and the squared errors of the score. Mirrors refine/losses/image.rs.

const COVERAGE_WEIGHT: f32 = 1.0;

fn difference_at(i: u32) -> vec4<f32> {
    return image[i] - unpack4x8unorm(source_view[i]);
}

@compute @workgroup_size(16, 16)
fn find_residual(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) {
        return;
    }
    let i = index_of(pixel);
    let d = difference_at(i);
    residual[i] = vec4<f32>(d.rgb - params.background * d.a, COVERAGE_WEIGHT * d.a);
}

// The gradient at the antialiased pixels, and the loss of each tile.
@compute @workgroup_size(16, 16)
fn image_loss(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let pixel = pixel_of(group, local);
    var loss = 0.0;
    if is_within(pixel) {
        let i = index_of(pixel);
        let e = residual[i];
        var laplace = vec4<f32>(0.0);
        var slope = 0.0;
        for (var direction = 0u; direction < 4u; direction++) {
            let next = neighbour(pixel, direction);
            if next.exists {
                let d = residual[next.index] - e;
                laplace += d;
                // Forward differences alone: each pair counts once.
                slope += select(dot(d, d), 0.0, (direction & 1u) == 1u);
            }
        }
        loss = dot(e, e) + params.gradient_weight * slope;
        let g = (e - laplace * params.gradient_weight) * (2.0 / f32(params.size * params.size));
        image_gradient[i] = vec4<f32>(g.rgb, COVERAGE_WEIGHT * g.a - params.background * (g.r + g.g + g.b));
    }
    let sum = sum_of_group(vec4<f32>(loss, 0.0, 0.0, 0.0), index);
    if index == 0u {
        partials[params.first_partial + group.y * params.tiles_in_row + group.x] = sum;
    }
}

// Of a difference of colours: its square over black, and over white.
fn squares_of(d: vec4<f32>) -> vec4<f32> {
    let over_white = d.rgb - d.a;
    return vec4<f32>(dot(d.rgb, d.rgb), dot(over_white, over_white), 0.0, 0.0);
}

// The squared errors of each tile over black and over white.
@compute @workgroup_size(16, 16)
fn squared_errors(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let pixel = pixel_of(group, local);
    var errors = vec4<f32>(0.0);
    if is_within(pixel) {
        errors = squares_of(difference_at(index_of(pixel)));
    }
    let sum = sum_of_group(errors, index);
    if index == 0u {
        partials[params.first_partial + group.y * params.tiles_in_row + group.x] = sum;
    }
}

// The difference of the colours before antialiasing. Beyond the rectangle there is nothing to compare.
fn base_difference_at(pixel: vec2<u32>) -> vec4<f32> {
    if !is_within(pixel) {
        return vec4<f32>(0.0);
    }
    let i = index_of(pixel);
    return base[i] - unpack4x8unorm(source_view[i]);
}

// The same of an image without antialiasing, whose pixels are compared as means of two by two.
@compute @workgroup_size(16, 16)
fn squared_errors_of_means(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let pixel = pixel_of(group, local);
    var errors = vec4<f32>(0.0);
    if pixel.x % 2u == 0u && pixel.y % 2u == 0u {
        let four = base_difference_at(pixel)
            + base_difference_at(pixel + vec2<u32>(1u, 0u))
            + base_difference_at(pixel + vec2<u32>(0u, 1u))
            + base_difference_at(pixel + vec2<u32>(1u, 1u));
        errors = squares_of(four * 0.25);
    }
    let sum = sum_of_group(errors, index);
    if index == 0u {
        partials[params.first_partial + group.y * params.tiles_in_row + group.x] = sum;
    }
}
