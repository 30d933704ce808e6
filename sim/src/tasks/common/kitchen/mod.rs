//! Dishes, pots, food, and cooking with them.

pub(crate) mod bottle;
pub(crate) mod can;
pub(crate) mod cooking;
pub(crate) mod dish;
pub(crate) mod fruit;
pub(crate) mod pot;
pub(crate) mod tray;
