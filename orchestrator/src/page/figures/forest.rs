//! Forest plot: differences with their intervals, one row per cell or group.

use plotters::style::RGBColor;

use crate::page::canvas::{Anchor, Axis, GRID, INK, svg};

/// A row of a forest plot. Numbers are in percentage points.
pub(crate) struct ForestRow {
    pub(crate) label: String,
    pub(crate) difference: f64,
    pub(crate) interval: [f64; 2],
    pub(crate) color: RGBColor,
    /// `true` for a mean over cells, which is drawn thicker.
    pub(crate) is_mean: bool,
}

const WIDTH: f64 = 720.0;
const ROW: f64 = 17.0;
const LABELS: f64 = 270.0;

/// Draws the rows between `names[1] better` on the left and `names[0] better` on the right. `margin` is
/// shaded.
pub(crate) fn forest(rows: &[ForestRow], names: [&str; 2], margin: f64) -> anyhow::Result<String> {
    let top = 30.0;
    let bottom = top + rows.len() as f64 * ROW;
    let extent = rows.iter().flat_map(|row| row.interval).map(f64::abs).fold(10.0, f64::max);
    let extent = ((extent / 10.0).ceil() * 10.0).min(100.0);
    svg([WIDTH as u32, (bottom + 30.0) as u32], |canvas| {
        let axis = Axis { values: [-extent, extent], pixels: [LABELS, WIDTH - 20.0] };
        canvas.rectangle([axis.at(-margin), top], [axis.at(margin), bottom], RGBColor(240, 243, 246))?;
        canvas.grid(&axis, [top, bottom], "")?;
        let zero = axis.at(0.0);
        canvas.line(&[[zero, top], [zero, bottom]], INK, 1)?;
        canvas.text([zero - 8.0, 14.0], &format!("← {} better", names[1]), 13.0, Anchor::End)?;
        canvas.text([zero + 8.0, 14.0], &format!("{} better →", names[0]), 13.0, Anchor::Start)?;
        for (idx, row) in rows.iter().enumerate() {
            let y = top + (idx as f64 + 0.5) * ROW;
            if row.is_mean && idx > 0 && !rows[idx - 1].is_mean {
                canvas.line(&[[10.0, y - ROW / 2.0], [WIDTH - 20.0, y - ROW / 2.0]], GRID, 2)?;
            }
            canvas.text([LABELS - 8.0, y], &row.label, 12.0, Anchor::End)?;
            let ends = row.interval.map(|value| [axis.at(value), y]);
            canvas.line(&ends, row.color, if row.is_mean { 3 } else { 1 })?;
            canvas.dot([axis.at(row.difference), y], if row.is_mean { 5 } else { 3 }, row.color)?;
        }
        Ok(())
    })
}
