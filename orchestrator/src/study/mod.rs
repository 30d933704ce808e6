//! From rows to conclusions: comparisons, the text of a run, the page of `report`, and measurements of speed.

pub(crate) mod analysis;
pub(crate) mod machine;
pub(crate) mod page;
pub(crate) mod report;
pub(crate) mod speed;
