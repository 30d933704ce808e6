//! Charts of rows: a label, then bars, intervals or dots on a common axis, then a note. They show success
//! rates, changes, shares of a whole, and differences (forest plots).

use crate::study::page::drawings::canvas::{
    Axis, Canvas, Color, FigureLegend, GRID, INK, MARGIN, NARROW_MARGIN, TextAnchor, column_width, svgs,
};

/// The frame of a chart: what all rows have in common.
pub(crate) struct RowChart<'a> {
    pub(crate) legend: FigureLegend,
    /// Values at the ends of the axis.
    pub(crate) range: [f64; 2],
    /// Unit of the values, with a space before.
    pub(crate) unit: &'static str,
    /// The better side right of zero and the one left of it, and the margin around zero that is shaded.
    pub(crate) sides: Option<([&'a str; 2], f64)>,
}

/// Rows with a common label.
pub(crate) struct ChartRowGroup {
    pub(crate) label: String,
    pub(crate) rows: Vec<ChartRow>,
}

/// A row, in the unit of the axis.
pub(crate) struct ChartRow {
    /// Bars from a value to another.
    pub(crate) bars: Vec<([f64; 2], Color)>,
    pub(crate) interval: Option<[f64; 2]>,
    pub(crate) dot: Option<f64>,
    /// Colour of interval and dot.
    pub(crate) color: Color,
    /// `true` for a mean over other rows, which is drawn thicker.
    pub(crate) is_mean: bool,
    /// The text beside the row, which tells its values.
    pub(crate) note: String,
}

/// Height of a row, and of a label above rows.
const ROW: f64 = 16.0;
/// Space between groups.
const GAP: f64 = 6.0;

impl ChartRow {
    /// Makes a row of a single bar from zero.
    pub(crate) fn bar(value: f64, interval: Option<[f64; 2]>, color: Color, note: String) -> Self {
        Self { bars: vec![([0.0, value], color)], interval, dot: None, color: INK, is_mean: false, note }
    }

    fn draw(&self, canvas: &mut Canvas, axis: &Axis, y: f64) {
        let middle = y + ROW / 2.0;
        for ([from, to], color) in &self.bars {
            let [from, to] = [axis.at(*from), axis.at(*to)];
            canvas.rectangle([from.min(to), y + 1.0], [from.max(to), y + ROW - 1.0], *color);
        }
        let weight = if self.is_mean { 3.0 } else { 1.5 };
        if let Some(interval) = self.interval {
            canvas.line(&interval.map(|bound| [axis.at(bound), middle]), self.color, weight, false);
        }
        if let Some(dot) = self.dot {
            canvas.dot([axis.at(dot), middle], 2.0 + weight, self.color);
        }
    }
}

impl RowChart<'_> {
    /// Draws the groups below each other; `None` without any.
    pub(crate) fn draw(&self, groups: &[ChartRowGroup]) -> Option<[String; 2]> {
        (!groups.is_empty()).then(|| svgs(|canvas| self.draw_on(canvas, groups)))
    }

    fn draw_on(&self, canvas: &mut Canvas, groups: &[ChartRowGroup]) -> f64 {
        let (is_narrow, width) = (canvas.is_narrow(), canvas.width);
        let labels = groups.iter().map(|group| &*group.label);
        let left = if is_narrow { NARROW_MARGIN } else { column_width(labels, 0.35 * width) };
        let notes = groups.iter().flat_map(|group| &group.rows).map(|row| &*row.note);
        let right = width - column_width(notes, 0.5 * width);
        let axis = Axis::linear(self.range, [left, right]);
        let above = if is_narrow { ROW } else { 0.0 };
        let height = |group: &ChartRowGroup| above + ROW * group.rows.len() as f64 + GAP;
        let top = canvas.legend(&self.legend);
        let bottom = top + groups.iter().map(height).sum::<f64>();
        if let Some((names, margin)) = self.sides {
            let band = [-margin, margin].map(|value| axis.at(value));
            canvas.rectangle([band[0], top], [band[1], bottom], Color(240, 243, 246));
            let [better, worse] = [format!("{} better →", names[0]), format!("← {} better", names[1])];
            if is_narrow {
                canvas.text([MARGIN, 9.0], &worse, TextAnchor::Start);
                canvas.text([width - MARGIN, 27.0], &better, TextAnchor::End);
            } else {
                canvas.text([axis.at(0.0) - 8.0, 18.0], &worse, TextAnchor::End);
                canvas.text([axis.at(0.0) + 8.0, 18.0], &better, TextAnchor::Start);
            }
        }
        canvas.grid(&axis, [top - 4.0, bottom], self.unit);
        let mut y = top;
        let is_mean = |group: &ChartRowGroup| group.rows.iter().any(|row| row.is_mean);
        for (idx, group) in groups.iter().enumerate() {
            if idx > 0 && is_mean(group) && !is_mean(&groups[idx - 1]) {
                canvas.line(&[[MARGIN, y], [width - MARGIN, y]], GRID, 2.0, false);
            }
            if is_narrow {
                canvas.text([MARGIN, y + ROW / 2.0], &group.label, TextAnchor::Start);
            } else {
                canvas.text([left - MARGIN, y + 0.5 * height(group)], &group.label, TextAnchor::End);
            }
            for (idx, row) in group.rows.iter().enumerate() {
                let y = y + above + 0.5 * GAP + ROW * idx as f64;
                row.draw(canvas, &axis, y);
                canvas.text([right + MARGIN, y + ROW / 2.0], &row.note, TextAnchor::Start);
            }
            y += height(group);
        }
        canvas.line(&[[axis.at(0.0), top - 4.0], [axis.at(0.0), bottom]], INK, 1.0, false);
        bottom + 26.0
    }
}
