//! Horizontal bars in groups: success rates or changes, one bar per policy.

use crate::study::page::drawings::canvas::{
    Axis, Color, INK, MARGIN, NARROW_MARGIN, TextAnchor, column_width, svgs,
};

/// A group of bars with a common label.
pub(crate) struct BarGroup {
    pub(crate) label: String,
    pub(crate) bars: Vec<Bar>,
}

/// One bar.
pub(crate) struct Bar {
    /// Value in percent or percentage points.
    pub(crate) value: f64,
    /// Interval around it, drawn as a line.
    pub(crate) interval: Option<[f64; 2]>,
    /// The text beside the bar, which tells value and interval.
    pub(crate) note: String,
    pub(crate) color: Color,
}

/// Height of a bar, and of a label above bars.
const BAR: f64 = 16.0;
/// Space between groups.
const GAP: f64 = 8.0;

/// Draws the groups below each other. `range` is in the unit of the values.
pub(crate) fn bars(groups: &[BarGroup], legend: &[(String, Color)], range: [f64; 2]) -> [String; 2] {
    svgs(|canvas| {
        let is_narrow = canvas.is_narrow();
        let labels = groups.iter().map(|group| &*group.label);
        let labels = if is_narrow { NARROW_MARGIN } else { column_width(labels, 0.35 * canvas.width) };
        let notes = groups.iter().flat_map(|group| &group.bars).map(|bar| &*bar.note);
        let notes = column_width(notes, 0.5 * canvas.width);
        let axis = Axis::linear(range, [labels, canvas.width - notes]);
        let above = if is_narrow { BAR } else { 0.0 };
        let top = canvas.legend(legend);
        let n_bars: usize = groups.iter().map(|group| group.bars.len()).sum();
        let bottom = top + n_bars as f64 * BAR + groups.len() as f64 * (GAP + above);
        canvas.grid(&axis, [top - 4.0, bottom], "");
        let zero = axis.at(0.0);
        let mut y = top;
        for group in groups {
            let height = BAR * group.bars.len() as f64;
            if is_narrow {
                canvas.text([MARGIN, y + BAR / 2.0], &group.label, TextAnchor::Start);
            } else {
                canvas.text([labels - 8.0, y + height / 2.0], &group.label, TextAnchor::End);
            }
            y += above;
            for bar in &group.bars {
                let (end, middle) = (axis.at(bar.value), y + BAR / 2.0);
                canvas.rectangle([zero.min(end), y + 1.0], [zero.max(end), y + BAR - 1.0], bar.color);
                if let Some(interval) = bar.interval {
                    canvas.line(&interval.map(|bound| [axis.at(bound), middle]), INK, 1.0, false);
                }
                canvas.text([canvas.width - notes + MARGIN, middle], &bar.note, TextAnchor::Start);
                y += BAR;
            }
            y += GAP;
        }
        canvas.line(&[[zero, top - 4.0], [zero, bottom]], INK, 1.0, false);
        bottom + 26.0
    })
}
