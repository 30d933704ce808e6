//! The two ends of a lane: the sim's and the policy host's, made of senders, receivers and wake-ups.

pub(crate) mod host;
pub(crate) mod receiver;
pub(crate) mod sender;
pub(crate) mod sim;
pub(crate) mod wake;
