//! datasets and rig files, read ahead on a thread.
