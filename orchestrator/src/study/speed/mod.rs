//! Measurement of speed over the number of envs: the paper's FPS experiment, and where the time goes.
//!
//! A *series* is a policy in a query mode; a *point* is a series with a number of envs. Every point is a
//! fleet of its own, which evaluates episodes for a given time and is then stopped. `plan` chooses the
//! points, `measure` runs one, `store` keeps finished ones for a resume, and `output` writes table and files.

mod measure;
mod output;
mod plan;
mod point;
mod store;

pub(crate) use self::measure::{StopControl, measure};
pub(crate) use self::output::{table, write_files};
pub(crate) use self::plan::{Omission, PlannedPoint, SpeedPlan};

pub(crate) use self::store::{PointStore, SpeedSettings};
