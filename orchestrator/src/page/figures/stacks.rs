//! Stacked horizontal bars: shares of a whole, one row per policy.

use plotters::style::RGBColor;

use crate::page::canvas::{Anchor, Axis, svg};

/// A row of a stack.
pub(crate) struct StackRow {
    pub(crate) label: String,
    /// Parts in the order of the legend, in the unit of the axis.
    pub(crate) parts: Vec<f64>,
    /// Text at the end of the bar.
    pub(crate) note: String,
}

const WIDTH: f64 = 720.0;
const ROW: f64 = 24.0;
const LABELS: f64 = 150.0;
/// Width of the notes.
const NOTES: f64 = 150.0;

/// Draws the rows. The legend names the parts; it may take several lines.
pub(crate) fn stacks(rows: &[StackRow], legend: &[(String, RGBColor)], unit: &str) -> anyhow::Result<String> {
    let lines: Vec<&[(String, RGBColor)]> = legend.chunks(2).collect();
    let top = 14.0 + 20.0 * lines.len() as f64;
    let bottom = top + ROW * rows.len() as f64;
    let total = |row: &StackRow| row.parts.iter().sum::<f64>();
    let max = rows.iter().map(total).fold(1e-9, f64::max);
    svg([WIDTH as u32, (bottom + 30.0) as u32], |canvas| {
        let axis = Axis { values: [0.0, max], pixels: [LABELS, WIDTH - NOTES] };
        for (idx, line) in lines.iter().enumerate() {
            canvas.legend(20.0, 14.0 + 20.0 * idx as f64, line)?;
        }
        canvas.grid(&axis, [top, bottom], unit)?;
        for (idx, row) in rows.iter().enumerate() {
            let y = top + ROW * idx as f64;
            canvas.text([LABELS - 8.0, y + ROW / 2.0], &row.label, 13.0, Anchor::End)?;
            let mut sum = 0.0;
            for (part, (_, color)) in row.parts.iter().zip(legend) {
                let from = axis.at(sum);
                sum += part;
                canvas.rectangle([from, y + 4.0], [axis.at(sum), y + ROW - 4.0], *color)?;
            }
            canvas.text([axis.at(sum) + 6.0, y + ROW / 2.0], &row.note, 12.0, Anchor::Start)?;
        }
        Ok(())
    })
}
