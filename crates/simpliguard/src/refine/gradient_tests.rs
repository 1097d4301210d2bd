//! Gradients against central differences, on a smooth convex scene: a sphere with a smooth texture, fitted to an image of
//! a larger, shifted sphere.

use glam::{Affine3A, Vec2, Vec3, Vec4};

use super::backend::ViewGradient;
use super::backward::Gradients;
use super::forward::FrameBuffers;
use super::losses::ImageLoss;
use super::low_poly::{LowPoly, TexelGrid};
use crate::animation::Motions;
use crate::data::{Atlas, TriMesh};
use crate::geometry::BoundingSphere;
use crate::render::{Camera, EMPTY_PIXEL, Image, Rect};

const SIZE: usize = 256;
const TEXTURE: usize = 64;

/// An octahedron, each face divided into `n` x `n` and pushed onto the unit sphere; seen from +z, u and v follow x and y.
fn sphere(n: usize) -> LowPoly {
    let mut mesh = TriMesh::default();
    let mut ids = std::collections::BTreeMap::new();
    for octant in 0..8 {
        let sign = |bit: usize| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let (sx, sy, sz) = (sign(0), sign(1), sign(2));
        let mut at = |i: usize, j: usize| {
            let (a, b) = (i as f32 / n as f32, j as f32 / n as f32);
            let p = Vec3::new(sx * a, sy * b, sz * (1.0 - a - b)).normalize();
            let key = (p * 1e4).round().as_ivec3().to_array();
            *ids.entry(key).or_insert_with(|| {
                mesh.positions.push(p);
                mesh.positions.len() as u32 - 1
            })
        };
        let mut triangles = Vec::new();
        for i in 0..n {
            for j in 0..n - i {
                triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < n {
                    triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
        let flip = sx * sy * sz < 0.0;
        mesh.triangles.extend(triangles.into_iter().map(|[a, b, c]| if flip { [a, c, b] } else { [a, b, c] }));
    }
    let uv = |v: u32| (mesh.positions[v as usize].truncate() * Vec2::new(0.45, -0.45)) + 0.5;
    let atlas = Atlas { uvs: mesh.triangles.iter().map(|t| t.map(uv)).collect(), ..Atlas::default() };
    let texels = (0..TEXTURE * TEXTURE)
        .map(|i| {
            let (x, y) = ((i % TEXTURE) as f32 / TEXTURE as f32, (i / TEXTURE) as f32 / TEXTURE as f32);
            Vec4::new(0.5 + 0.4 * (5.0 * x).sin(), 0.5 + 0.4 * (4.0 * y).cos(), 0.3 + 0.4 * x, 1.0)
        })
        .collect();
    LowPoly::new(
        &mesh,
        &atlas,
        false,
        TexelGrid { size: TEXTURE, texels, covered: vec![true; TEXTURE * TEXTURE], opacity: Vec::new() },
    )
}

fn camera() -> Camera {
    Camera::orbit(&BoundingSphere { centre: Vec3::ZERO, radius: 1.3 }, Vec3::new(0.1, 0.2, 0.97).normalize(), 0.7, 1.0)
}

fn all() -> Rect {
    Rect { x0: 0, y0: 0, x1: SIZE, y1: SIZE }
}

fn target() -> Image {
    let mut shifted = sphere(8);
    shifted.positions.iter_mut().for_each(|p| *p = *p * 1.06 + Vec3::new(0.03, -0.02, 0.0));
    let mut frame = FrameBuffers::new(SIZE);
    frame.render(&shifted, &camera(), None, all());
    let pixels = frame.image.iter().map(|c| (*c * 255.0 + 0.5).to_array().map(|c| c as u8)).collect();
    Image { size: SIZE, pixels }
}

fn loss(low: &LowPoly, target: &Image, background: f32, lambda: f32) -> (f64, FrameBuffers, ImageLoss) {
    let mut frame = FrameBuffers::new(SIZE);
    frame.render(low, &camera(), None, all());
    let mut loss = ImageLoss::default();
    let value = loss.run(&frame, target, background, lambda);
    (value, frame, loss)
}

/// Cosine and ratio of the lengths of the analytic gradient and central differences, over the vertices that move most.
fn compare(background: f32, lambda: f32) -> (f64, f64) {
    let (mut low, target) = (sphere(4), target());
    let (_, frame, run) = loss(&low, &target, background, lambda);
    let mut gradients = ViewGradient::default();
    Gradients::default().backward_to_vertices(&low, &frame, &run.gradient, &mut gradients);
    let mut order: Vec<usize> = (0..low.positions.len()).collect();
    let length = |v: &usize| gradients.positions[*v].length();
    order.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let (mut both, mut analytic, mut numeric) = (0.0, 0.0, 0.0);
    for &v in &order[..30] {
        for axis in 0..3 {
            // About a pixel: smaller steps measure single pixels that change their triangle.
            let h = 0.012;
            let mut at = |step: f32| {
                low.positions[v][axis] += step;
                let value = loss(&low, &target, background, lambda).0;
                low.positions[v][axis] -= step;
                value
            };
            let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let gradient = f64::from(gradients.positions[v][axis]);
            both += difference * gradient;
            analytic += gradient * gradient;
            numeric += difference * difference;
        }
    }
    (both / (analytic * numeric).sqrt(), (analytic / numeric).sqrt())
}

#[test]
fn vertex_gradients_point_along_central_differences() {
    for (background, lambda) in [(0.0, 0.0), (1.0, 0.0), (1.0, 0.5)] {
        let (cosine, ratio) = compare(background, lambda);
        assert!(cosine > 0.9, "background {background}, lambda {lambda}: cosine {cosine}");
        assert!((0.75..1.3).contains(&ratio), "background {background}, lambda {lambda}: ratio {ratio}");
    }
}

#[test]
fn texture_gradients_match_central_differences() {
    let target = target();
    let mut low = sphere(4);
    let (_, frame, run) = loss(&low, &target, 0.0, 0.5);
    // Over the pixels that count only: at others the two images shall agree.
    let counts: Vec<bool> = {
        let mut counts: Vec<bool> =
            (0..SIZE * SIZE).map(|i| frame.raster.ids[i] != EMPTY_PIXEL && target.pixels[i][3] == 255).collect();
        frame
            .silhouettes
            .blends
            .iter()
            .for_each(|b| (counts[b.near as usize], counts[b.far as usize]) = (false, false));
        counts
    };
    let mut gradients = Gradients::default();
    gradients.backward_to_texels(&low, &frame, &target, &run.gradient);
    let mut order: Vec<usize> = (0..low.texture.texels.len()).collect();
    order.sort_by(|a, b| gradients.texels[*b].length().total_cmp(&gradients.texels[*a].length()));
    for &texel in &order[..20] {
        for slot in 0..3 {
            let h = 0.05;
            let mut at = |step: f32| {
                low.texture.texels[texel][slot] += step;
                let (_, mut moved, _) = loss(&low, &target, 0.0, 0.5);
                low.texture.texels[texel][slot] -= step;
                for (i, counts) in counts.iter().enumerate() {
                    if !counts {
                        moved.image[i] = frame.image[i];
                    }
                }
                ImageLoss::default().run(&moved, &target, 0.0, 0.5)
            };
            let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let gradient = f64::from(gradients.texels[texel][slot]);
            let scale = f64::from(gradients.texels[texel].length());
            assert!((difference - gradient).abs() < 1e-4 * scale, "{difference} {gradient}");
        }
    }
}

#[test]
fn gradients_in_a_pose_are_those_at_rest_turned_back() {
    let target = target();
    let gradients = |low: &LowPoly, pose| {
        let mut frame = FrameBuffers::new(SIZE);
        frame.render(low, &camera(), pose, all());
        let mut loss = ImageLoss::default();
        loss.run(&frame, &target, 1.0, 0.5);
        let mut gradients = ViewGradient::default();
        Gradients::default().backward_to_vertices(low, &frame, &loss.gradient, &mut gradients);
        gradients.positions
    };
    let still = sphere(4);
    // The same sphere lying on its side and twice as large at rest, which the pose sets upright.
    let stand = Affine3A::from_scale(Vec3::splat(0.5)) * Affine3A::from_rotation_x(std::f32::consts::FRAC_PI_2);
    let mut lying = still.clone().with_motions(Motions::new(vec![vec![stand; still.positions.len()]]));
    lying.positions.iter_mut().for_each(|p| *p = stand.inverse().transform_point3(*p));
    let (expected, found) = (gradients(&still, None), gradients(&lying, Some(0)));
    let largest = expected.iter().map(|g| g.length()).fold(0.0, f32::max);
    for (g, e) in found.iter().zip(&expected) {
        let back = stand.matrix3.transpose() * *e;
        assert!(g.distance(back) < 0.02 * largest, "{g} {back}");
    }
}

/// Root mean square error of the coverage of pixels on the outline, against many samples a pixel.
fn coverage_error(low: &LowPoly) -> f64 {
    const SAMPLES: usize = 8;
    let mut frame = FrameBuffers::new(SIZE);
    frame.render(low, &camera(), None, all());
    let fine = SAMPLES * SIZE;
    let mut samples = FrameBuffers::new(fine);
    samples.rasterise(low, &camera(), None, Rect { x0: 0, y0: 0, x1: fine, y1: fine });
    let mut covered = vec![0_u32; SIZE * SIZE];
    for (i, _) in samples.raster.ids.iter().enumerate().filter(|(_, id)| **id != EMPTY_PIXEL) {
        covered[i / fine / SAMPLES * SIZE + i % fine / SAMPLES] += 1;
    }
    let (mut sum, mut count) = (0.0, 0.0);
    for (pixel, covered) in frame.image.iter().zip(covered) {
        let exact = f64::from(covered) / (SAMPLES * SAMPLES) as f64;
        if exact > 0.0 && exact < 1.0 {
            sum += (f64::from(pixel.w) - exact).powi(2);
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

#[test]
fn outlines_are_antialiased_whatever_the_size_of_the_faces() {
    for divisions in [2, 8, 40] {
        let error = coverage_error(&sphere(divisions));
        assert!(error < 0.06, "{divisions}: {error}");
    }
}

#[test]
fn the_loss_of_a_picture_against_itself_is_its_rounding() {
    let low = sphere(8);
    let mut frame = FrameBuffers::new(SIZE);
    frame.render(&low, &camera(), None, all());
    let pixels = frame.image.iter().map(|c| (*c * 255.0 + 0.5).to_array().map(|c| c as u8)).collect();
    let value = loss(&low, &Image { size: SIZE, pixels }, 1.0, 0.5).0;
    assert!(value < 1e-4, "{value}");
}

#[test]
fn image_gradients_match_central_differences() {
    let (low, target) = (sphere(4), target());
    let (_, mut frame, run) = loss(&low, &target, 1.0, 0.5);
    for pixel in [SIZE * 128 + 128, SIZE * 80 + 133, SIZE * 173 + 53] {
        for slot in 0..4 {
            let h = 1e-2;
            let mut at = |step: f32| {
                frame.image[pixel][slot] += step;
                let value = ImageLoss::default().run(&frame, &target, 1.0, 0.5);
                frame.image[pixel][slot] -= step;
                value
            };
            let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let gradient = f64::from(run.gradient[pixel][slot]);
            assert!((difference - gradient).abs() < 1e-4 * gradient.abs().max(1e-4), "{difference} {gradient}");
        }
    }
}
