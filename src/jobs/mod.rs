//! Jobs: what is done with a mask, and the durable queue of what is still to be done.

pub mod process;
