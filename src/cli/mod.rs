//! The command line: arguments in, one call, an exit code out.

pub mod serve;

pub mod probe;
