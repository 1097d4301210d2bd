//! Differentiable rendering: texture by least squares, vertices by gradient descent (paper 3.4).
//!
//! The level is rendered with analytic antialiasing (`forward`) and compared with the views of the source (`losses`). The
//! error is carried back to the vertices (`backward`), and Adam moves them (`optimizer`, `optimise`). Steps that flip
//! faces or make the mesh intersect itself are rolled back (`constraints`). For fixed vertices the texture that fits the
//! views best is a linear problem: bilinear sampling couples a texel with its eight neighbours only, so its normal
//! equations are a nine-point stencil, however many views there are (`texture_least_squares`). The paper's gradient descent
//! on the texture (`texture_adam`) is there to compare with.
//!
//! Colours are sRGB encoded here: errors then weigh as they are seen.
//!
//! Pictures of the level are made by a [`Backend`]: [`Cpu`] in this crate, GPUs in `simpliguard_gpu`.

mod backend;
mod backward;
mod batch;
mod constraints;
mod covered_views;
mod cpu;
mod forward;
#[cfg(test)]
mod gradient_tests;
mod lookup;
mod losses;
mod low_poly;
mod opacity;
mod optimise;
mod optimizer;
mod params;
mod silhouettes;
mod skin;
mod texture_adam;
#[cfg(test)]
mod texture_fit_tests;
mod texture_least_squares;
mod train_validation;
mod variables;
mod view_order;
mod view_target;

pub use backend::{BATCH, Backend, Device, DeviceError, Drawing, LevelRenderer, LossTerms, ViewGradient};
pub use covered_views::CoveredViews;
pub use cpu::Cpu;
pub use low_poly::{LowPoly, NO_NEIGHBOUR, TexelGrid};
pub use params::{RefineParams, Solver, TextureAdam, TextureFit};
pub use skin::Skin;
pub use texture_least_squares::{CoarseSolution, LeastSquares};
pub use view_target::ViewTarget;

use self::optimise::Optimisation;
use self::train_validation::TrainValidationSplit;
use self::variables::Variables;
use crate::Cancellation;
use crate::render::View;

/// Gain of the refinement: mean PSNR in dB over views that were not fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Refined {
    /// With the initial texture.
    pub psnr_initial: f32,
    /// With the fitted texture on the vertices as given.
    pub psnr_texture: f32,
    /// At the end.
    pub psnr: f32,
}

/// Fits `low` to the views, and `skin` to those in other poses. By the views held out, the result is never worse than the
/// start.
///
/// Ends early if cancelled: `low` and `skin` are then valid but unfinished, for the caller to discard.
///
/// # Errors
/// If the device fails. `low` and `skin` are then unfinished too.
pub fn refine<E>(
    (low, skin): (&mut LowPoly, Option<&mut Skin<'_>>),
    target: &ViewTarget<'_>,
    params: &RefineParams,
    backend: &dyn Backend<Error = E>,
    cancellation: &Cancellation,
) -> Result<Refined, E> {
    let mut split = TrainValidationSplit::new(target.views, low, backend, cancellation)?;
    let refined = fit_texture_to(&mut split, low, params.texture.as_ref())?;
    if params.steps == 0 || low.triangles.is_empty() {
        return Ok(refined);
    }
    let optimisation = Optimisation::new(low, target, params, backend, cancellation);
    let psnr = optimisation.run(Variables { low, skin }, &mut split, refined.psnr)?;
    Ok(Refined { psnr, ..refined })
}

/// Fits the texture alone, to views without antialiasing: an antialiased pixel shows more texels than one lookup mixes, and
/// a texture fitted to it is too sharp or too soft under any other filter. Keeps the initial texture if the fitted one does
/// not match the views held out better.
///
/// Ends early if cancelled.
///
/// # Errors
/// If the device fails. The texture is then unfinished. A cut-out needs [`Cpu`], which never fails.
pub fn fit_texture<E>(
    low: &mut LowPoly,
    views: &[View],
    fit: Option<&TextureFit>,
    backend: &dyn Backend<Error = E>,
    cancellation: &Cancellation,
) -> Result<Refined, E> {
    fit_texture_to(&mut TrainValidationSplit::aliased(views, low, backend, cancellation)?, low, fit)
}

/// Fits the outlines of a cut-out to views without antialiasing. Keeps those it has if the fitted ones do not match the views
/// held out better. Changes nothing that is no cut-out.
///
/// Ends early if cancelled.
pub fn fit_opacity(low: &mut LowPoly, views: &[View], cancellation: &Cancellation) {
    if low.texture.opacity.is_empty() {
        return;
    }
    let Ok(mut split) = TrainValidationSplit::aliased(views, low, &Cpu, cancellation);
    let (initial, Ok(before)) = (low.texture.opacity.clone(), split.score(low));
    opacity::fit_opacity(low, &split.train, cancellation);
    let Ok(after) = split.score(low);
    if after <= before {
        low.texture.opacity = initial;
    }
}

/// Least gain of a fitted texture of a cut-out, in dB. The leaves that a view shows beside those of the level blur it, and
/// a smaller gain is lost under other filters.
const CUT_OUT_GAIN: f32 = 0.25;

fn fit_texture_to<E>(
    split: &mut TrainValidationSplit<'_, E>,
    low: &mut LowPoly,
    fit: Option<&TextureFit>,
) -> Result<Refined, E> {
    let psnr_initial = split.score(low)?;
    let Some(fit) = fit else { return Ok(Refined { psnr_initial, psnr_texture: psnr_initial, psnr: psnr_initial }) };
    let initial = low.texture.texels.clone();
    split.fit_texture(low, Some(fit))?;
    let psnr_texture = split.score(low)?;
    let least_gain = if low.texture.opacity.is_empty() { 0.0 } else { CUT_OUT_GAIN };
    if psnr_texture < psnr_initial + least_gain {
        low.texture.texels = initial;
        return Ok(Refined { psnr_initial, psnr_texture, psnr: psnr_initial });
    }
    Ok(Refined { psnr_initial, psnr_texture, psnr: psnr_texture })
}
