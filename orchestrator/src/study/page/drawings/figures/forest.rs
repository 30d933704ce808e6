//! Forest plot: differences with their intervals, one row per cell or group.

use crate::study::page::drawings::canvas::{
    Axis, Color, GRID, INK, MARGIN, NARROW_MARGIN, TextAnchor, column_width, svgs,
};

/// A row of a forest plot. Numbers are in percentage points.
pub(crate) struct ForestRow {
    pub(crate) label: String,
    pub(crate) difference: f64,
    pub(crate) interval: [f64; 2],
    /// Number of pairs.
    pub(crate) n: u32,
    pub(crate) color: Color,
    /// `true` for a mean over cells, which is drawn thicker.
    pub(crate) is_mean: bool,
}

const ROW: f64 = 18.0;

/// Draws the rows between `names[1] better` on the left and `names[0] better` on the right. `margin` is
/// shaded.
pub(crate) fn forest(rows: &[ForestRow], names: [&str; 2], margin: f64) -> [String; 2] {
    let extent = rows.iter().flat_map(|row| row.interval).map(f64::abs).fold(10.0, f64::max);
    let extent = ((extent / 10.0).ceil() * 10.0).min(100.0);
    svgs(|canvas| {
        let is_narrow = canvas.is_narrow();
        let label = |row: &ForestRow| {
            if is_narrow { format!("{}, n {}", row.label, row.n) } else { row.label.clone() }
        };
        let note = |row: &ForestRow| {
            let ForestRow { difference, interval: [low, high], n, .. } = row;
            let n = if is_narrow { String::new() } else { format!(", n {n}") };
            format!("{difference:+.1} [{low:+.1}, {high:+.1}]{n}")
        };
        let [label_texts, note_texts]: [Vec<String>; 2] =
            [rows.iter().map(label).collect(), rows.iter().map(note).collect()];
        let width = |texts: &[String], limit: f64| {
            column_width(texts.iter().map(String::as_str), limit * canvas.width)
        };
        let labels = if is_narrow { NARROW_MARGIN } else { width(&label_texts, 0.35) };
        let notes = width(&note_texts, 0.5);
        let height = if is_narrow { 2.0 * ROW } else { ROW };
        let axis = Axis::linear([-extent, extent], [labels, canvas.width - notes]);
        let top = 2.0 * ROW;
        let bottom = top + rows.len() as f64 * height;
        canvas.rectangle([axis.at(-margin), top], [axis.at(margin), bottom], Color(240, 243, 246));
        canvas.grid(&axis, [top, bottom], "");
        let zero = axis.at(0.0);
        canvas.line(&[[zero, top], [zero, bottom]], INK, 1.0, false);
        if is_narrow {
            canvas.text([MARGIN, 0.5 * ROW], &format!("← {} better", names[1]), TextAnchor::Start);
            canvas.text([canvas.width - 8.0, 1.5 * ROW], &format!("{} better →", names[0]), TextAnchor::End);
        } else {
            canvas.text([zero - 8.0, ROW], &format!("← {} better", names[1]), TextAnchor::End);
            canvas.text([zero + 8.0, ROW], &format!("{} better →", names[0]), TextAnchor::Start);
        }
        for (idx, row) in rows.iter().enumerate() {
            let start = top + idx as f64 * height;
            let y = start + height - 0.5 * ROW;
            if row.is_mean && idx > 0 && !rows[idx - 1].is_mean {
                canvas.line(&[[8.0, start], [canvas.width - 8.0, start]], GRID, 2.0, false);
            }
            if is_narrow {
                canvas.text([MARGIN, start + 0.5 * ROW], &label_texts[idx], TextAnchor::Start);
            } else {
                canvas.text([labels - 8.0, y], &label_texts[idx], TextAnchor::End);
            }
            let ends = row.interval.map(|value| [axis.at(value), y]);
            canvas.line(&ends, row.color, if row.is_mean { 3.0 } else { 1.5 }, false);
            canvas.dot([axis.at(row.difference), y], if row.is_mean { 5.0 } else { 3.0 }, row.color);
            canvas.text([canvas.width - notes + MARGIN, y], &note_texts[idx], TextAnchor::Start);
        }
        bottom + 26.0
    })
}
