//! Fields of a protobuf message (protobuf.dev/programming-guides/encoding), for Foxglove's schemas in that encoding.

use crate::error::DecodeError;

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Field<'a> {
    /// A varint, or a fixed number of four or eight bytes, as its bits.
    Number(u64),
    /// Text, bytes, an embedded message, or packed numbers.
    Bytes(&'a [u8]),
}

/// The fields of a message with their numbers, in order.
pub(crate) fn fields(mut bytes: &[u8]) -> Result<Vec<(u64, Field<'_>)>, DecodeError> {
    let cut = || DecodeError::new("a protobuf message is cut");
    let mut out = Vec::new();
    while !bytes.is_empty() {
        let (tag, rest) = varint(bytes).ok_or_else(cut)?;
        let (field, rest) = match tag & 7 {
            0 => varint(rest).map(|(v, rest)| (Field::Number(v), rest)),
            1 => rest.split_first_chunk::<8>().map(|(v, rest)| (Field::Number(u64::from_le_bytes(*v)), rest)),
            5 => rest
                .split_first_chunk::<4>()
                .map(|(v, rest)| (Field::Number(u64::from(u32::from_le_bytes(*v))), rest)),
            2 => varint(rest).and_then(|(n, rest)| {
                let (head, rest) = rest.split_at_checked(usize::try_from(n).ok()?)?;
                Some((Field::Bytes(head), rest))
            }),
            other => return Err(DecodeError::new(format!("a protobuf field of wire type {other}"))),
        }
        .ok_or_else(cut)?;
        out.push((tag >> 3, field));
        bytes = rest;
    }
    Ok(out)
}

fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut value = 0u64;
    for (i, byte) in bytes.iter().enumerate().take(10) {
        value |= u64::from(byte & 0x7f).checked_shl(7 * i as u32)?;
        if byte & 0x80 == 0 {
            return Some((value, &bytes[i + 1..]));
        }
    }
    None
}

/// The nanoseconds of a `google.protobuf.Timestamp` at the start of a message, from its first bytes; `None` if there is
/// none.
pub(crate) fn first_stamp(prefix: &[u8]) -> Option<i64> {
    let (tag, rest) = varint(prefix)?;
    let (n, rest) = varint(rest)?;
    let inside = rest.get(..usize::try_from(n).ok()?)?;
    if tag != 1 << 3 | 2 { None } else { stamp_ns(inside) }
}

/// The nanoseconds of a `google.protobuf.Timestamp`.
pub(crate) fn stamp_ns(bytes: &[u8]) -> Option<i64> {
    let mut ns = 0i64;
    for (number, field) in fields(bytes).ok()? {
        match (number, field) {
            (1, Field::Number(seconds)) => {
                ns = ns.checked_add((seconds as i64).checked_mul(1_000_000_000)?)?
            }
            (2, Field::Number(nanos)) => ns = ns.checked_add(nanos as i64)?,
            _ => {}
        }
    }
    Some(ns)
}

/// Decodes packed `double`s.
pub(crate) fn doubles(bytes: &[u8]) -> Vec<f64> {
    let of = |b: &[u8]| {
        let mut raw = [0; 8];
        raw.copy_from_slice(b);
        f64::from_le_bytes(raw)
    };
    bytes.chunks_exact(8).map(of).collect()
}

/// Decodes text.
pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
