//! The kinds of figures of the report, each drawn from numbers.

mod chart;
mod radar;
mod rows;

pub(crate) use self::chart::{Curve, chart, fps_svgs, within_percent};
pub(crate) use self::radar::{RadarSeries, radar};
pub(crate) use self::rows::{ChartRow, ChartRowGroup, RowChart};
