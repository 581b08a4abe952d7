//! Encoding of numbers in a part: little-endian, in columns rather than rows.
//!
//! A column of multi-byte numbers is stored as planes, first all lowest bytes, last all highest: the high
//! bytes of coordinates are nearly equal, and block compression shrinks equal adjacent bytes.

use super::error::StoreError;

/// Collects the bytes of a part.
#[derive(Debug, Default)]
pub(crate) struct Encoder(pub Vec<u8>);

impl Encoder {
    pub fn u8(&mut self, v: u8) {
        self.0.push(v);
    }

    pub fn u32(&mut self, v: u32) {
        self.0.extend(v.to_le_bytes());
    }

    pub fn u64(&mut self, v: u64) {
        self.0.extend(v.to_le_bytes());
    }

    pub fn f64(&mut self, v: f64) {
        self.u64(v.to_bits());
    }

    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|v| self.f64(*v));
    }

    /// Length and bytes; truncated to 65,535 of them.
    pub fn text(&mut self, text: &str) {
        let end = (0..=text.len().min(usize::from(u16::MAX))).rev().find(|i| text.is_char_boundary(*i));
        let text = &text[..end.unwrap_or(0)];
        self.0.extend((text.len() as u16).to_le_bytes());
        self.0.extend(text.as_bytes());
    }

    /// A column without its length, in planes.
    pub fn column<const N: usize>(&mut self, values: impl ExactSizeIterator<Item = [u8; N]>) {
        let (start, n) = (self.0.len(), values.len());
        self.0.resize(start + N * n, 0);
        let planes = &mut self.0[start..];
        for (i, bytes) in values.enumerate() {
            for (k, byte) in bytes.into_iter().enumerate() {
                planes[k * n + i] = byte;
            }
        }
    }

    pub fn column_u32(&mut self, values: &[u32]) {
        self.column(values.iter().map(|v| v.to_le_bytes()));
    }

    pub fn column_f32(&mut self, values: &[f32]) {
        self.column(values.iter().map(|v| v.to_bits().to_le_bytes()));
    }

    pub fn column_f64(&mut self, values: &[f64]) {
        self.column(values.iter().map(|v| v.to_bits().to_le_bytes()));
    }
}

/// Reads the bytes of a part; missing or surplus bytes are an error that names the part.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    part: &'a str,
    rest: &'a [u8],
}

impl<'a> Decoder<'a> {
    pub fn new(part: &'a str, bytes: &'a [u8]) -> Self {
        Self { part, rest: bytes }
    }

    /// An error about this part.
    pub fn wrong(&self, why: impl Into<String>) -> StoreError {
        StoreError::part(self.part, why)
    }

    pub fn bytes(&mut self, n: usize) -> Result<&'a [u8], StoreError> {
        let (here, rest) = self
            .rest
            .split_at_checked(n)
            .ok_or_else(|| self.wrong(format!("it has {} bytes where {n} are needed", self.rest.len())))?;
        self.rest = rest;
        Ok(here)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], StoreError> {
        let bytes = self.bytes(N)?;
        Ok(std::array::from_fn(|i| bytes[i]))
    }

    pub fn u8(&mut self) -> Result<u8, StoreError> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u32(&mut self) -> Result<u32, StoreError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn u64(&mut self) -> Result<u64, StoreError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub fn f64(&mut self) -> Result<f64, StoreError> {
        Ok(f64::from_bits(self.u64()?))
    }

    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], StoreError> {
        let mut values = [0.0; N];
        for v in &mut values {
            *v = self.f64()?;
        }
        Ok(values)
    }

    pub fn text(&mut self) -> Result<String, StoreError> {
        let length = u16::from_le_bytes(self.array()?);
        let bytes = self.bytes(usize::from(length))?;
        String::from_utf8(bytes.to_vec()).map_err(|_| self.wrong("a text in it is not UTF-8"))
    }

    /// The planes of a column of `n` values, one after the other.
    fn planes<const N: usize>(&mut self, n: usize) -> Result<[&'a [u8]; N], StoreError> {
        let whole = n.checked_mul(N).ok_or_else(|| self.wrong(format!("a column of {n} values")))?;
        let bytes = self.bytes(whole)?;
        Ok(std::array::from_fn(|k| &bytes[k * n..(k + 1) * n]))
    }

    pub fn column_u32(&mut self, n: usize) -> Result<Vec<u32>, StoreError> {
        let [a, b, c, d] = self.planes(n)?;
        Ok((0..n).map(|i| u32::from_le_bytes([a[i], b[i], c[i], d[i]])).collect())
    }

    pub fn column_u16(&mut self, n: usize) -> Result<Vec<u16>, StoreError> {
        let [a, b] = self.planes(n)?;
        Ok((0..n).map(|i| u16::from_le_bytes([a[i], b[i]])).collect())
    }

    pub fn column_f32(&mut self, n: usize) -> Result<Vec<f32>, StoreError> {
        Ok(self.column_u32(n)?.into_iter().map(f32::from_bits).collect())
    }

    pub fn column_i64(&mut self, n: usize) -> Result<Vec<i64>, StoreError> {
        let planes: [&[u8]; 8] = self.planes(n)?;
        Ok((0..n).map(|i| i64::from_le_bytes(std::array::from_fn(|k| planes[k][i]))).collect())
    }

    pub fn column_f64(&mut self, n: usize) -> Result<Vec<f64>, StoreError> {
        Ok(self.column_i64(n)?.into_iter().map(|bits| f64::from_bits(bits as u64)).collect())
    }

    /// Checks that no bytes are left.
    pub fn end(self) -> Result<(), StoreError> {
        match self.rest.len() {
            0 => Ok(()),
            n => Err(self.wrong(format!("it has {n} bytes too many"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn columns_round_trip(a in prop::collection::vec(any::<u32>(), 0..40), b in prop::collection::vec(any::<u64>(), 0..40), text in ".{0,20}") {
            let (floats, doubles): (Vec<f32>, Vec<f64>) =
                (a.iter().map(|v| f32::from_bits(*v)).collect(), b.iter().map(|v| f64::from_bits(*v)).collect());
            let mut e = Encoder::default();
            e.column_u32(&a);
            e.text(&text);
            e.column_f32(&floats);
            e.column_f64(&doubles);
            let mut d = Decoder::new("it", &e.0);
            prop_assert_eq!(d.column_u32(a.len()).unwrap(), a);
            prop_assert_eq!(d.text().unwrap(), text);
            let bits = |v: Vec<f32>| v.into_iter().map(f32::to_bits).collect::<Vec<_>>();
            prop_assert_eq!(bits(d.column_f32(floats.len()).unwrap()), bits(floats));
            let bits = |v: Vec<f64>| v.into_iter().map(f64::to_bits).collect::<Vec<_>>();
            prop_assert_eq!(bits(d.column_f64(doubles.len()).unwrap()), b);
            d.end().unwrap();
        }
    }

    #[test]
    fn missing_and_surplus_bytes_are_errors() {
        let message = Decoder::new("it", &[1, 2, 3]).column_u32(usize::MAX / 2).unwrap_err().to_string();
        assert!(message.contains("part 'it'"), "{message}");
        assert!(Decoder::new("it", &[1, 2, 3]).u32().unwrap_err().to_string().contains("3 bytes where 4"));
        assert!(Decoder::new("it", &[1]).end().unwrap_err().to_string().contains("too many"));
    }
}
