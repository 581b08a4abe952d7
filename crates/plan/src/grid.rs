//! The frame of a grid in the world, cell addresses, and a plain grid of values.
//!
//! Row 0 is the row of least y, as in ROS `OccupancyGrid`; the corner of cell (0, 0) is the origin of the grid frame.

use cairn_geometry::{Se2, Vec2};

/// Greatest number of cells along one side: squared distances in cells then fit 32 bits.
pub const MAX_SIDE: usize = 32_766;
/// Greatest number of cells of a grid: path costs then fit the packed words of the search.
pub const MAX_CELLS: usize = 1 << 26;

/// A grid that cannot exist.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// No cells at all.
    #[error("the grid is empty ({width} x {height} cells)")]
    Empty {
        /// Cells along x.
        width: usize,
        /// Cells along y.
        height: usize,
    },
    /// More cells than [`MAX_SIDE`] or [`MAX_CELLS`] allow.
    #[error("{width} x {height} cells are too many (at most {MAX_SIDE} a side and {MAX_CELLS} in all)")]
    TooLarge {
        /// Cells along x.
        width: usize,
        /// Cells along y.
        height: usize,
    },
    /// The size of a cell is not a positive finite number.
    #[error("the resolution of {0} m a cell is not a positive number")]
    Resolution(f64),
    /// The pose of the grid holds NaN or infinity.
    #[error("the origin of the grid is not finite")]
    Origin,
    /// The number of values is not width times height.
    #[error("{given} values for {expected} cells")]
    Values {
        /// Values given.
        given: usize,
        /// Cells of the grid.
        expected: usize,
    },
}

/// Address of a cell: column `x`, row `y`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Cell {
    /// Column, from 0 at the least x.
    pub x: u32,
    /// Row, from 0 at the least y.
    pub y: u32,
}

impl Cell {
    /// The cell at this column and row.
    pub fn new(x: u32, y: u32) -> Self {
        Self { x, y }
    }
}

/// Size, resolution and pose of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridFrame {
    width: usize,
    height: usize,
    resolution_m: f64,
    world_from_grid: Se2,
}

impl GridFrame {
    /// A grid of `width` x `height` cells of `resolution_m` metres whose corner of least x and y lies at
    /// `world_from_grid`.
    ///
    /// # Errors
    /// When it has no cells, too many, a resolution that is not positive or a pose that is not finite.
    pub fn new(
        width: usize,
        height: usize,
        resolution_m: f64,
        world_from_grid: Se2,
    ) -> Result<Self, GridError> {
        if width == 0 || height == 0 {
            return Err(GridError::Empty { width, height });
        }
        if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_CELLS {
            return Err(GridError::TooLarge { width, height });
        }
        if !(resolution_m.is_finite() && resolution_m > 0.0) {
            return Err(GridError::Resolution(resolution_m));
        }
        let (t, r) = (world_from_grid.translation, world_from_grid.rotation);
        if ![t.x, t.y, r.cos(), r.sin()].iter().all(|v| v.is_finite()) {
            return Err(GridError::Origin);
        }
        Ok(Self { width, height, resolution_m, world_from_grid })
    }

    /// A grid without a pose in the world: cells of one metre, the corner at the origin.
    ///
    /// # Errors
    /// When it has no cells or too many.
    pub fn unit(width: usize, height: usize) -> Result<Self, GridError> {
        Self::new(width, height, 1.0, Se2::identity())
    }

    /// Cells along x.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Cells along y.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Never true: an empty grid cannot be made.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Side of a cell in metres.
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Pose of the corner of cell (0, 0).
    pub fn world_from_grid(&self) -> Se2 {
        self.world_from_grid
    }

    /// The same area with cells of `1 / times` the size.
    ///
    /// # Errors
    /// When it would have too many cells, or none (`times` = 0).
    pub fn refined(&self, times: usize) -> Result<Self, GridError> {
        let (width, height) = (self.width.saturating_mul(times), self.height.saturating_mul(times));
        Self::new(width, height, self.resolution_m / times as f64, self.world_from_grid)
    }

    /// Whether the address lies in the grid.
    pub fn contains(&self, cell: Cell) -> bool {
        (cell.x as usize) < self.width && (cell.y as usize) < self.height
    }

    /// Row-major index of a cell; `None` outside.
    pub fn index(&self, cell: Cell) -> Option<usize> {
        self.contains(cell).then(|| cell.y as usize * self.width + cell.x as usize)
    }

    /// The cell at this row-major index; only for indices below [`GridFrame::len`].
    pub fn cell(&self, index: usize) -> Cell {
        Cell::new((index % self.width) as u32, (index / self.width) as u32)
    }

    /// A point (metres, world) in cells along x and y from the corner (cell (0, 0) spans 0 to 1).
    pub fn in_cells(&self, point: Vec2) -> Vec2 {
        self.world_from_grid.inverse() * point / self.resolution_m
    }

    /// The cell that contains a point (metres, world); `None` outside and for NaN.
    pub fn cell_at(&self, point: Vec2) -> Option<Cell> {
        let p = self.in_cells(point);
        let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < self.width as f64 && p.y < self.height as f64;
        inside.then(|| Cell::new(p.x as u32, p.y as u32))
    }

    /// The centre of a cell in the world, in metres.
    pub fn centre(&self, cell: Cell) -> Vec2 {
        let p = Vec2::new(f64::from(cell.x) + 0.5, f64::from(cell.y) + 0.5);
        self.world_from_grid * (p * self.resolution_m)
    }
}

/// A value for each cell, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    frame: GridFrame,
    values: Vec<T>,
}

impl<T: Copy> Grid<T> {
    /// The same value everywhere.
    pub fn filled(frame: GridFrame, value: T) -> Self {
        Self { frame, values: vec![value; frame.len()] }
    }

    /// From values in row-major order, starting with the row of least y.
    ///
    /// # Errors
    /// When the number of values is not the number of cells.
    pub fn from_values(frame: GridFrame, values: Vec<T>) -> Result<Self, GridError> {
        if values.len() != frame.len() {
            return Err(GridError::Values { given: values.len(), expected: frame.len() });
        }
        Ok(Self { frame, values })
    }

    /// Size, resolution and pose of the grid.
    pub fn frame(&self) -> &GridFrame {
        &self.frame
    }

    /// All values, row by row.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// All values, mutable.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The values of one row; empty outside.
    pub fn row(&self, y: usize) -> &[T] {
        let from = y.saturating_mul(self.frame.width);
        self.values.get(from..from.saturating_add(self.frame.width)).unwrap_or_default()
    }

    /// The value of a cell; `None` outside.
    pub fn get(&self, cell: Cell) -> Option<T> {
        self.frame.index(cell).and_then(|i| self.values.get(i).copied())
    }

    /// Sets a cell; returns whether it lies in the grid.
    pub fn set(&mut self, cell: Cell, value: T) -> bool {
        let place = self.frame.index(cell).and_then(|i| self.values.get_mut(i));
        place.map(|v| *v = value).is_some()
    }

    /// The window of `width` x `height` cells whose lowest column and row are `x` and `y` (they may be outside), filled
    /// with `outside` where this grid has no cells: for a window that rolls with a robot.
    ///
    /// # Errors
    /// When the window is empty or too large.
    pub fn window(&self, x: i64, y: i64, width: usize, height: usize, outside: T) -> Result<Self, GridError> {
        let res = self.frame.resolution_m;
        let corner = Se2::from_xy_angle(x as f64 * res, y as f64 * res, 0.0);
        let frame = GridFrame::new(width, height, res, self.frame.world_from_grid * corner)?;
        let mut window = Self::filled(frame, outside);
        let from = x.clamp(0, self.frame.width as i64) as usize;
        let to = x.saturating_add(width as i64).clamp(0, self.frame.width as i64) as usize;
        for row in 0..height {
            let source =
                usize::try_from(y.saturating_add(row as i64)).ok().filter(|&s| s < self.frame.height);
            if let Some(source) = source.filter(|_| from < to) {
                let at = row * width + (from as i64 - x) as usize;
                window.values[at..at + to - from].copy_from_slice(&self.row(source)[from..to]);
            }
        }
        Ok(window)
    }

    /// A grid of values computed from each value.
    pub fn map<U: Copy>(&self, mut of: impl FnMut(T) -> U) -> Grid<U> {
        Grid { frame: self.frame, values: self.values.iter().map(|&v| of(v)).collect() }
    }

    /// Each cell split into `times` x `times` cells of the same value.
    ///
    /// # Errors
    /// When that makes too many cells, or none.
    pub fn refined(&self, times: usize) -> Result<Self, GridError> {
        let frame = self.frame.refined(times)?;
        let mut values = Vec::with_capacity(frame.len());
        for y in 0..frame.height {
            let row = self.row(y / times);
            values.extend(row.iter().flat_map(|&v| std::iter::repeat_n(v, times)));
        }
        Self::from_values(frame, values)
    }
}
