//! Arrays of the caller are copied once on the way in; results are returned as arrays.
//!
//! Shape and type are checked before a byte is copied, so that no array, however large it claims to be, makes the
//! process allocate more than an image of the camera. Any stride is read in place; what is not aligned or not in the
//! byte order of the machine is converted by numpy first.

use crate::errors::FrameError;
use cairn::geometry::{Mat3, Se3, Sim3, So3, Vec3};
use cairn::sensor::{Camera, DepthImage, GrayImage, Image, check_rotation};
use cairn::sources::NEAREST_DEPTH_M;
use numpy::ndarray::{ArrayViewD, Axis, Ix2, Ix3};
use numpy::{
    Element, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods,
    PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Order of the channels of a colour image.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// Red first.
    Rgb,
    /// Blue first, as OpenCV has it.
    Bgr,
}

impl Channels {
    /// From `"rgb"` or `"bgr"`.
    pub fn parse(name: &str) -> PyResult<Self> {
        match name {
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            _ => Err(PyValueError::new_err(format!("color must be \"rgb\" or \"bgr\", not {name:?}"))),
        }
    }
}

/// An array as it is, or what `numpy.asarray` makes of something else.
pub fn array<'py>(any: &Bound<'py, PyAny>, what: &str) -> PyResult<Bound<'py, PyUntypedArray>> {
    if let Ok(array) = any.cast::<PyUntypedArray>() {
        return Ok(array.clone());
    }
    let wrong = || {
        let kind = any.get_type().name().map_or_else(|_| "this".into(), |n| n.to_string());
        PyTypeError::new_err(format!("{what}: an array is expected, not {kind}"))
    };
    // Numbers, strings and dictionaries become arrays without dimensions, which is never what a caller means.
    let made = any.py().import("numpy")?.call_method1("asarray", (any,))?;
    let made = made.cast_into::<PyUntypedArray>().map_err(|_| wrong())?;
    if made.ndim() == 0 || made.dtype().kind() == b'O' { Err(wrong()) } else { Ok(made) }
}

fn wrong_type(what: &str, array: &Bound<'_, PyUntypedArray>, wanted: &str) -> PyErr {
    PyTypeError::new_err(format!("{what}: dtype {wanted} is expected, not {}", array.dtype()))
}

/// The elements as `T`; `name` is numpy's name of that type. The kind must have been checked.
fn typed<'py, T: Element>(
    array: &Bound<'py, PyUntypedArray>,
    name: &str,
    what: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let busy = |_| PyValueError::new_err(format!("{what}: the array is being written by another thread"));
    if array.is_aligned()
        && let Ok(same) = array.cast::<PyArrayDyn<T>>()
    {
        return same.try_readonly().map_err(busy);
    }
    let converted = array.call_method1("astype", (name,))?;
    converted.cast_into::<PyArrayDyn<T>>()?.try_readonly().map_err(busy)
}

/// All elements in rows, each converted, in one pass. Rows are iterated one by one: iterators over any number of
/// dimensions are twenty times slower where the elements are not contiguous.
fn converted<T: Copy, U>(view: &ArrayViewD<'_, T>, convert: impl Fn(T) -> U) -> Vec<U> {
    if let Some(rows) = view.as_slice() {
        return rows.iter().map(|&v| convert(v)).collect();
    }
    let mut out = Vec::with_capacity(view.len());
    match view.view().into_dimensionality::<Ix2>() {
        Ok(plane) => plane.rows().into_iter().for_each(|row| out.extend(row.iter().map(|&v| convert(v)))),
        Err(_) => out.extend(view.iter().map(|&v| convert(v))),
    }
    out
}

/// All elements in rows; one copy.
fn copied<T: Element + Copy>(view: &ArrayViewD<'_, T>) -> Vec<T> {
    match view.as_slice() {
        Some(rows) => rows.to_vec(),
        None => converted(view, |v| v),
    }
}

/// The plane of an image with one channel, (height, width) or (height, width, 1).
fn plane<T>(view: ArrayViewD<'_, T>) -> ArrayViewD<'_, T> {
    if view.ndim() == 3 { view.index_axis_move(Axis(2), 0) } else { view }
}

fn check_size(what: &str, shape: &[usize], camera: &Camera) -> PyResult<()> {
    let [height, width, ..] = shape[..] else {
        let why =
            format!("{what}: an array of height x width is expected, not of {} dimensions", shape.len());
        return Err(FrameError::new_err(why));
    };
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    let why = format!(
        "{what}: the image is {width}x{height} pixels (width x height), its calibration is for {}x{}",
        camera.width, camera.height
    );
    Err(FrameError::new_err(why))
}

/// A grey image of a camera: uint8, height x width or height x width x 1, 3 or 4 channels (the fourth is left out).
pub fn gray(any: &Bound<'_, PyAny>, what: &str, camera: &Camera, order: Channels) -> PyResult<GrayImage> {
    let array = array(any, what)?;
    check_size(what, array.shape(), camera)?;
    if (array.dtype().kind(), array.dtype().itemsize()) != (b'u', 1) {
        return Err(wrong_type(what, &array, "uint8"));
    }
    let channels = channels_of(what, array.shape())?;
    let array = typed::<u8>(&array, "uint8", what)?;
    let pixels = match channels {
        1 => copied(&plane(array.as_array())),
        _ => colours(&array.as_array(), order, luminance)?,
    };
    GrayImage::from_vec(camera.width, camera.height, pixels)
        .ok_or_else(|| FrameError::new_err(format!("{what}: rows are missing")))
}

fn channels_of(what: &str, shape: &[usize]) -> PyResult<usize> {
    match shape {
        [_, _] => Ok(1),
        [_, _, channels @ (1 | 3 | 4)] => Ok(*channels),
        _ => {
            let why = format!(
                "{what}: gray (height, width) or colour (height, width, 3) is expected, not {shape:?}"
            );
            Err(FrameError::new_err(why))
        }
    }
}

/// Applies a function to red, green and blue of each pixel of a view with three or four channels.
fn colours<U>(
    view: &ArrayViewD<'_, u8>,
    order: Channels,
    convert: impl Fn([u8; 3]) -> U,
) -> PyResult<Vec<U>> {
    let view = view.view().into_dimensionality::<Ix3>().map_err(|e| FrameError::new_err(e.to_string()))?;
    let (height, width, channels) = view.dim();
    let of = |a: u8, b: u8, c: u8| convert(if order == Channels::Rgb { [a, b, c] } else { [c, b, a] });
    match (view.as_slice(), channels) {
        (Some(rows), 3) => return Ok(rows.as_chunks::<3>().0.iter().map(|p| of(p[0], p[1], p[2])).collect()),
        (Some(rows), 4) => return Ok(rows.as_chunks::<4>().0.iter().map(|p| of(p[0], p[1], p[2])).collect()),
        _ => {}
    }
    let mut out = Vec::with_capacity(height * width);
    for row in view.outer_iter() {
        let [first, second, third] = [0, 1, 2].map(|channel| row.index_axis(Axis(1), channel));
        let pixels = first.into_iter().zip(second).zip(third);
        out.extend(pixels.map(|((&a, &b), &c)| of(a, b, c)));
    }
    Ok(out)
}

/// ITU-R BT.601 in 16 bits, as recordings are read.
fn luminance([r, g, b]: [u8; 3]) -> u8 {
    ((u32::from(r) * 19595 + u32::from(g) * 38470 + u32::from(b) * 7471 + 32768) >> 16) as u8
}

/// A colour image of a camera; grey ones give three equal channels.
pub fn rgb(any: &Bound<'_, PyAny>, what: &str, camera: &Camera, order: Channels) -> PyResult<Image<[u8; 3]>> {
    let array = array(any, what)?;
    check_size(what, array.shape(), camera)?;
    if (array.dtype().kind(), array.dtype().itemsize()) != (b'u', 1) {
        return Err(wrong_type(what, &array, "uint8"));
    }
    let channels = channels_of(what, array.shape())?;
    let array = typed::<u8>(&array, "uint8", what)?;
    let pixels = match channels {
        1 => converted(&plane(array.as_array()), |v| [v; 3]),
        _ => colours(&array.as_array(), order, |pixel| pixel)?,
    };
    Image::from_vec(camera.width, camera.height, pixels)
        .ok_or_else(|| FrameError::new_err(format!("{what}: rows are missing")))
}

/// A depth image in units of `metres_per_unit`. uint16 in units of `scale` metres (where none is given, the sensor's);
/// floats in units of `scale` metres (where none is given, metres). 0, NaN, infinity, negative and too large depths are
/// no measurement.
pub fn depth(
    any: &Bound<'_, PyAny>,
    camera: &Camera,
    metres_per_unit: f64,
    scale: Option<f64>,
) -> PyResult<DepthImage> {
    let array = array(any, "depth")?;
    check_depth(&array, camera)?;
    if let Some(scale) = scale.filter(|s| !(s.is_finite() && *s > 0.0)) {
        let why = format!("depth_scale must be a positive number of metres per unit, not {scale}");
        return Err(PyValueError::new_err(why));
    }
    let units = match (array.dtype().kind(), array.dtype().itemsize()) {
        (b'u', 1 | 2) => {
            let array = typed::<u16>(&array, "uint16", "depth")?;
            check_unit(&plane(array.as_array()), scale.unwrap_or(metres_per_unit))?;
            match scale.map(|s| s / metres_per_unit).filter(|factor| (factor - 1.0).abs() > 1e-9) {
                None => copied(&plane(array.as_array())),
                Some(factor) => converted(&plane(array.as_array()), |v| unit(f64::from(v) * factor)),
            }
        }
        (b'f', 8) => {
            let factor = scale.unwrap_or(1.0) / metres_per_unit;
            let array = typed::<f64>(&array, "float64", "depth")?;
            converted(&plane(array.as_array()), |v| unit(v * factor))
        }
        (b'f', 2 | 4) => {
            let factor = (scale.unwrap_or(1.0) / metres_per_unit) as f32;
            let array = typed::<f32>(&array, "float32", "depth")?;
            converted(&plane(array.as_array()), |v| unit32(v * factor))
        }
        _ => return Err(wrong_type("depth", &array, "uint16, float32 or float64")),
    };
    DepthImage::from_vec(camera.width, camera.height, units)
        .ok_or_else(|| FrameError::new_err("depth: rows are missing"))
}

/// Refuses integers that are metres: no depth camera measures only what is so near.
fn check_unit(units: &ArrayViewD<'_, u16>, metres_per_unit: f64) -> PyResult<()> {
    let farthest = units.iter().copied().filter(|v| *v != u16::MAX).max().unwrap_or(0);
    let farthest_m = f64::from(farthest) * metres_per_unit;
    if farthest == 0 || farthest_m >= NEAREST_DEPTH_M {
        return Ok(());
    }
    Err(FrameError::new_err(format!(
        "depth: the farthest is {farthest} units of {metres_per_unit} m, {farthest_m:.3} m; if it is in metres, give floats, else \
         its unit as depth_scale"
    )))
}

/// Whether the elements are floating-point numbers.
pub fn is_float(any: &Bound<'_, PyAny>, what: &str) -> PyResult<bool> {
    Ok(array(any, what)?.dtype().kind() == b'f')
}

/// A depth image of floats in metres.
pub fn metres(any: &Bound<'_, PyAny>, camera: &Camera) -> PyResult<Image<f32>> {
    let array = array(any, "depth")?;
    check_depth(&array, camera)?;
    let pixels = copied(&plane(typed::<f32>(&array, "float32", "depth")?.as_array()));
    Image::from_vec(camera.width, camera.height, pixels)
        .ok_or_else(|| FrameError::new_err("depth: rows are missing"))
}

/// Refuses a depth image of another size, or with several channels.
fn check_depth(array: &Bound<'_, PyUntypedArray>, camera: &Camera) -> PyResult<()> {
    check_size("depth", array.shape(), camera)?;
    if array.ndim() != 2 && array.shape()[2..] != [1] {
        let why = format!("depth: one channel (height, width) is expected, not {:?}", array.shape());
        return Err(FrameError::new_err(why));
    }
    Ok(())
}

/// Rounded to a unit; 0 where it is no measurement.
fn unit(units: f64) -> u16 {
    let rounded = units + 0.5;
    // A cast saturates: NaN and negative numbers become 0.
    if rounded < 65_536.0 { rounded as u16 } else { 0 }
}

/// As [`unit`] (halves to the even one), for several pixels at once: above 2^23 the last bits of an `f32` are a whole number.
fn unit32(units: f32) -> u16 {
    let whole = (units + 8_388_608.0).to_bits() as u16;
    // NaN is in no range.
    if (0.0..65_535.5).contains(&units) { whole } else { 0 }
}

/// Numbers in `columns` columns and at most `limit` rows.
pub fn table(any: &Bound<'_, PyAny>, what: &str, columns: usize, limit: usize) -> PyResult<Vec<f64>> {
    let array = array(any, what)?;
    let shape = array.shape();
    // An empty list has no columns.
    if shape.contains(&0) && (shape.len() == 1 || shape[1..] == [columns]) {
        return Ok(Vec::new());
    }
    let fits = match shape {
        [rows] => columns == 1 && *rows <= limit,
        [rows, width] => *width == columns && columns > 1 && *rows <= limit,
        _ => false,
    };
    if !fits {
        let wanted = if columns == 1 { "(N,)".into() } else { format!("(N, {columns})") };
        let why = format!("{what}: shape {wanted} with at most {limit} rows is expected, not {shape:?}");
        return Err(PyValueError::new_err(why));
    }
    numbers(&array, what)
}

/// Integers in one column of at most `limit` rows.
pub fn integers(any: &Bound<'_, PyAny>, what: &str, limit: usize) -> PyResult<Vec<i64>> {
    let array = array(any, what)?;
    if array.ndim() != 1 || array.shape()[0] > limit {
        let why =
            format!("{what}: shape (N,) with at most {limit} rows is expected, not {:?}", array.shape());
        return Err(PyValueError::new_err(why));
    }
    match (array.dtype().kind(), array.dtype().itemsize()) {
        (b'i', _) | (b'u', 1..=4) => Ok(copied(&typed::<i64>(&array, "int64", what)?.as_array())),
        // An empty list has the type float.
        _ if array.shape()[0] == 0 => Ok(Vec::new()),
        _ => Err(wrong_type(what, &array, "int64")),
    }
}

fn numbers(array: &Bound<'_, PyUntypedArray>, what: &str) -> PyResult<Vec<f64>> {
    match array.dtype().kind() {
        b'f' | b'i' | b'u' => Ok(copied(&typed::<f64>(array, "float64", what)?.as_array())),
        _ => Err(wrong_type(what, array, "float64")),
    }
}

/// A rigid transform from a 4x4 matrix.
pub fn pose(any: &Bound<'_, PyAny>, what: &str) -> PyResult<Se3> {
    let array = array(any, what)?;
    if array.shape() != [4, 4] {
        return Err(PyValueError::new_err(format!(
            "{what}: a matrix of 4x4 is expected, not {:?}",
            array.shape()
        )));
    }
    let m = numbers(&array, what)?;
    if m.iter().any(|v| !v.is_finite()) {
        return Err(PyValueError::new_err(format!("{what}: a number is not finite")));
    }
    if m[12..].iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(a, b)| (a - b).abs() > 1e-6) {
        return Err(PyValueError::new_err(format!(
            "{what}: the last row must be 0 0 0 1, not {:?}",
            &m[12..]
        )));
    }
    let rotation = Mat3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    check_rotation(what, &rotation).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(Se3::new(So3::from_matrix(&rotation), Vec3::new(m[3], m[7], m[11])))
}

/// Rows of `N` numbers as an array (n, N).
pub fn rows<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, N])
}

/// The 16 numbers of a rigid transform, row by row.
fn sixteen(pose: &Se3) -> [f64; 16] {
    let m = pose.matrix();
    std::array::from_fn(|i| m[(i / 4, i % 4)])
}

/// A rigid transform as an array (4, 4).
pub fn matrix<'py>(py: Python<'py>, pose: &Se3) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, &sixteen(pose)).reshape([4, 4])
}

/// Rigid transforms as an array (n, 4, 4).
pub fn matrices<'a>(
    py: Python<'_>,
    poses: impl Iterator<Item = &'a Se3>,
) -> PyResult<Bound<'_, PyArray3<f64>>> {
    let all: Vec<[f64; 16]> = poses.map(sixteen).collect();
    let count = all.len();
    PyArray1::from_vec(py, all.into_flattened()).reshape([count, 4, 4])
}

/// A similarity as an array (4, 4): `scale * R` and `t`.
pub fn similarity_matrix<'py>(py: Python<'py>, s: &Sim3) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut numbers = sixteen(&Se3::new(s.rotation, s.translation));
    for i in [0, 1, 2, 4, 5, 6, 8, 9, 10] {
        numbers[i] *= s.scale;
    }
    PyArray1::from_slice(py, &numbers).reshape([4, 4])
}

/// A rotation as x, y, z, w with w not negative.
pub fn xyzw(rotation: &So3) -> [f64; 4] {
    let q = rotation.quaternion();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.i * sign, q.j * sign, q.k * sign, q.w * sign]
}

/// A point as an array (3,).
pub fn point<'py>(py: Python<'py>, p: &Vec3) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &[p.x, p.y, p.z])
}

/// An image as an array (height, width); a copy, so that it can be written to.
pub fn pixels<'py, T: Element + Copy + Default>(
    py: Python<'py>,
    image: &Image<T>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    PyArray1::from_slice(py, image.data()).reshape([image.height(), image.width()])
}

/// A time in nanoseconds from seconds, or from nanoseconds.
///
/// # Errors
/// Unless exactly one is given; for seconds that are not finite or beyond the range of 64 bits.
pub fn stamp(seconds: Option<f64>, ns: Option<i64>) -> PyResult<cairn::Stamp> {
    match (seconds, ns) {
        (Some(s), None) => from_seconds(s, "stamp"),
        (None, Some(ns)) => Ok(cairn::Stamp(ns)),
        (None, None) => Err(PyTypeError::new_err("stamp (seconds) or stamp_ns (nanoseconds) is needed")),
        (Some(_), Some(_)) => Err(PyTypeError::new_err("stamp or stamp_ns, not both")),
    }
}

/// A time from seconds.
///
/// # Errors
/// For seconds that are not finite or beyond the range of 64 bits of nanoseconds.
pub fn from_seconds(seconds: f64, what: &str) -> PyResult<cairn::Stamp> {
    if seconds.is_finite() && seconds.abs() < 9.2e9 {
        return Ok(cairn::Stamp::from_seconds(seconds));
    }
    Err(PyValueError::new_err(format!("{what}: {seconds} s is not a time (finite, within 292 years of 0)")))
}

/// Points as an array (n, 3).
pub fn points(py: Python<'_>, points: impl Iterator<Item = Vec3>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    rows(py, points.map(Into::into).collect::<Vec<[f64; 3]>>())
}
