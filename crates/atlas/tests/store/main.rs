//! Map files: what is saved comes back to the last bit, what is damaged is told, what was there stays.

mod beside;
mod damage;
mod fixtures;
mod history;
mod round_trip;
mod saving;
