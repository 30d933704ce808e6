//! The figures of the report: each file draws one kind from numbers.

mod bars;
mod forest;
mod radar;
mod scatter;
mod stacks;
mod steps;

pub(super) use self::bars::{Bar, BarGroup, bars};
pub(super) use self::forest::{ForestRow, forest};
pub(super) use self::radar::{RadarSeries, radar};
pub(crate) use self::scatter::{FpsSeries, fps_svgs};
pub(super) use self::scatter::{Scatter, regression};
pub(super) use self::stacks::{StackRow, stacks};
pub(super) use self::steps::{StepCurve, success_over_time};
