//! Checks of the workspace itself, as unit tests: which crate may import which, that no circle of files uses itself, and how large a
//! type may become. There is nothing here to import.

#[cfg(test)]
mod circles;
#[cfg(test)]
mod floors;
#[cfg(test)]
mod structs;
