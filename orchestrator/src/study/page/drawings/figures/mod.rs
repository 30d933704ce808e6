//! The figures of the report: each file draws one kind from numbers.

mod bars;
mod forest;
mod radar;
mod scatter;
mod stacks;
mod steps;

pub(crate) use self::bars::{Bar, BarGroup, bars};
pub(crate) use self::forest::{ForestRow, forest};
pub(crate) use self::radar::{RadarSeries, radar};
pub(crate) use self::scatter::{FpsSeries, fps_svgs};
pub(crate) use self::scatter::{Scatter, regression};
pub(crate) use self::stacks::{StackRow, stacks};
pub(crate) use self::steps::{StepCurve, success_over_time};
