//! Stacked horizontal bars: shares of a whole, one row per policy.

use crate::study::page::drawings::canvas::{
    Axis, Color, MARGIN, NARROW_MARGIN, TextAnchor, column_width, svgs,
};

/// A row of a stack.
pub(crate) struct StackRow {
    pub(crate) label: String,
    /// Parts in the order of the legend, in the unit of the axis.
    pub(crate) parts: Vec<f64>,
    /// Text at the end of the row.
    pub(crate) note: String,
}

const ROW: f64 = 24.0;

/// Draws the rows. The legend names the parts.
pub(crate) fn stacks(rows: &[StackRow], legend: &[(String, Color)], unit: &str) -> [String; 2] {
    let total = |row: &StackRow| row.parts.iter().sum::<f64>();
    let max = rows.iter().map(total).fold(1e-9, f64::max);
    svgs(|canvas| {
        let is_narrow = canvas.is_narrow();
        let labels = rows.iter().map(|row| &*row.label);
        let labels = if is_narrow { NARROW_MARGIN } else { column_width(labels, 0.35 * canvas.width) };
        let notes = column_width(rows.iter().map(|row| &*row.note), 0.5 * canvas.width);
        let above = if is_narrow { ROW - 6.0 } else { 0.0 };
        let axis = Axis::linear([0.0, max], [labels, canvas.width - notes]);
        let top = canvas.legend(legend);
        let bottom = top + (ROW + above) * rows.len() as f64;
        canvas.grid(&axis, [top, bottom], unit);
        for (idx, row) in rows.iter().enumerate() {
            let start = top + (ROW + above) * idx as f64;
            let y = start + above;
            if is_narrow {
                canvas.text([MARGIN, start + above / 2.0], &row.label, TextAnchor::Start);
            } else {
                canvas.text([labels - 8.0, y + ROW / 2.0], &row.label, TextAnchor::End);
            }
            let mut sum = 0.0;
            for (part, (_, color)) in row.parts.iter().zip(legend) {
                let from = axis.at(sum);
                sum += part;
                canvas.rectangle([from, y + 4.0], [axis.at(sum), y + ROW - 4.0], *color);
            }
            canvas.text([canvas.width - notes + MARGIN, y + ROW / 2.0], &row.note, TextAnchor::Start);
        }
        bottom + 26.0
    })
}
