//! pose-only and bundle adjustment over a map: one window builder.
