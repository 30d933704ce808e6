//! Horizontal bars in groups: success rates or changes, one bar per policy.

use plotters::style::RGBColor;

use crate::page::canvas::{Anchor, Axis, INK, svg};

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
    pub(crate) color: RGBColor,
}

/// Width of a figure.
const WIDTH: f64 = 720.0;
/// Height of a bar.
const BAR: f64 = 13.0;
/// Space between groups.
const GAP: f64 = 8.0;
/// Width of the labels.
const LABELS: f64 = 190.0;

/// Draws the groups below each other. `range` is in the unit of the values.
pub(crate) fn bars(
    groups: &[BarGroup],
    legend: &[(String, RGBColor)],
    range: [f64; 2],
    unit: &str,
) -> anyhow::Result<String> {
    let n_bars: usize = groups.iter().map(|group| group.bars.len()).sum();
    let top = 34.0;
    let bottom = top + n_bars as f64 * BAR + groups.len() as f64 * GAP;
    svg([WIDTH as u32, (bottom + 30.0) as u32], |canvas| {
        let axis = Axis { values: range, pixels: [LABELS, WIDTH - 60.0] };
        canvas.legend(LABELS, 14.0, legend)?;
        canvas.grid(&axis, [top - 4.0, bottom], unit)?;
        let mut y = top;
        for group in groups {
            let height = BAR * group.bars.len() as f64;
            canvas.text([LABELS - 8.0, y + height / 2.0], &group.label, 13.0, Anchor::End)?;
            for bar in &group.bars {
                let (zero, end) = (axis.at(0.0), axis.at(bar.value));
                canvas.rectangle([zero.min(end), y + 1.0], [zero.max(end), y + BAR - 1.0], bar.color)?;
                let mut text_x = zero.max(end);
                if let Some([low, high]) = bar.interval {
                    let middle = y + BAR / 2.0;
                    canvas.line(&[[axis.at(low), middle], [axis.at(high), middle]], INK, 1)?;
                    text_x = text_x.max(axis.at(high));
                }
                let text =
                    if range[0] < 0.0 { format!("{:+.1}", bar.value) } else { format!("{:.1}", bar.value) };
                canvas.text([text_x + 5.0, y + BAR / 2.0], &text, 12.0, Anchor::Start)?;
                y += BAR;
            }
            y += GAP;
        }
        let zero = axis.at(0.0);
        canvas.line(&[[zero, top - 4.0], [zero, bottom]], INK, 1)
    })
}
