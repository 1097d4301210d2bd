//! Charts as SVG files.

use std::error::Error;
use std::path::Path;

use plotters::prelude::*;

/// Width and height of a chart in pixels.
const SIZE: (u32, u32) = (720, 400);
/// Space around a chart, and below and beside its axes for their numbers, in pixels.
const SPACE: (u32, u32) = (16, 48);
/// Height of letters in pixels.
const LETTERS: u32 = 15;
/// Height of a bar, of one.
const BAR: f64 = 0.7;
/// Space between a bar and its name, as a part of the longest bar.
const GAP: f64 = 0.01;
/// Part of the width that is left beside the longest bar for its name, and margin of an axis as a part of its range.
const MARGIN: (f64, f64) = (0.35, 0.08);

/// A line of a chart: its name and its points from the left to the right.
pub(crate) type Line<'a> = (&'a str, Vec<(f64, f64)>);

/// Lines over one pair of axes, which are named.
pub(crate) fn lines(file: &Path, [x, y]: [&str; 2], lines: &[Line<'_>]) -> Result<(), Box<dyn Error>> {
    let points = || lines.iter().flat_map(|(_, points)| points);
    let across = range(points().map(|point| point.0));
    let up = range(points().map(|point| point.1));
    let area = SVGBackend::new(file, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(SPACE.0)
        .x_label_area_size(SPACE.1)
        .y_label_area_size(SPACE.1)
        .build_cartesian_2d(across, up)?;
    let letters = ("sans-serif", LETTERS);
    chart.configure_mesh().x_desc(x).y_desc(y).label_style(letters).light_line_style(WHITE).draw()?;
    for (i, (name, points)) in lines.iter().enumerate() {
        let color = Palette99::pick(i).to_rgba();
        chart
            .draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2)).point_size(3))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], color.stroke_width(2)));
    }
    let corner = SeriesLabelPosition::LowerRight;
    chart.configure_series_labels().position(corner).label_font(letters).border_style(BLACK).draw()?;
    Ok(area.present()?)
}

/// A bar for each value, from the top down, with its name and the value in `unit` beside it.
pub(crate) fn bars(file: &Path, unit: &str, bars: &[(String, f64)]) -> Result<(), Box<dyn Error>> {
    let most = bars.iter().map(|(_, value)| *value).fold(f64::MIN_POSITIVE, f64::max);
    let area = SVGBackend::new(file, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(SPACE.0)
        .build_cartesian_2d(0.0..most * (1.0 + MARGIN.0), bars.len() as f64..0.0)?;
    let place = |row: usize| row as f64 + (1.0 - BAR) / 2.0;
    let boxes = bars.iter().enumerate().map(|(row, (_, value))| {
        Rectangle::new([(0.0, place(row)), (*value, place(row) + BAR)], Palette99::pick(0).filled())
    });
    chart.draw_series(boxes)?;
    let names = bars.iter().enumerate().map(|(row, (name, value))| {
        let at = (value + GAP * most, place(row) + BAR / 4.0);
        Text::new(format!("{name} {value:.2} {unit}"), at, ("sans-serif", LETTERS))
    });
    chart.draw_series(names)?;
    Ok(area.present()?)
}

/// The range of some values with a margin on both sides, which does not reach below zero if no value does.
fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let beyond = MARGIN.1 * (most - least).max(f64::MIN_POSITIVE);
    let least = if least >= 0.0 { (least - beyond).max(0.0) } else { least - beyond };
    least..most + beyond
}
