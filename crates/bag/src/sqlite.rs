//! Reads tables of SQLite files (sqlite.org/fileformat2.html): only what rosbag2 recordings need.
//!
//! Why an own reader: SQLite itself would add its C library to every build, and it refuses a truncated file, whereas
//! this reader reads the pages that are there.

use crate::area::{Area, InputFile};
use crate::error::{BagError, Damage};

/// The first bytes of an SQLite file.
pub(crate) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Greatest length of a text, bytes: names, types and the definition of a table.
const MAX_TEXT: u64 = 64 << 10;

/// Deeper than any valid tree: 2^31 pages with two children each have fewer levels.
const MAX_DEPTH: usize = 32;

const INTERIOR: u8 = 5;
const LEAF: u8 = 13;

/// An open database.
pub(crate) struct Database {
    pub file: InputFile,
    page_size: u64,
    /// Usable bytes of a page.
    usable: u64,
    /// Number of pages in the file.
    pages: u64,
    /// Number of pages according to the header.
    pub stated_pages: u64,
}

/// A table: its root page and the names of its columns.
#[derive(Debug)]
pub(crate) struct Table {
    pub root: u32,
    columns: Vec<String>,
}

impl Table {
    /// The index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c.eq_ignore_ascii_case(name))
    }
}

/// A value of a row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Null,
    Integer(i64),
    Text(String),
    /// Start in the payload and length.
    Blob(u64, u64),
}

/// Position of a row, and its payload.
pub(crate) struct Row<'a> {
    pub page: u32,
    pub cell: u16,
    pub rowid: i64,
    pub database: &'a mut Database,
    payload: Payload,
}

/// The parts of a row's bytes: those on the page, then the chain of overflow pages.
#[derive(Clone, Copy)]
struct Payload {
    length: u64,
    at: u64,
    local: u64,
    overflow: u32,
}

impl Database {
    /// Opens a file that begins with [`MAGIC`].
    pub fn open(mut file: InputFile) -> Result<Self, BagError> {
        let unsupported = |file: &InputFile, why: String| BagError::Unsupported {
            path: file.shown(),
            why,
            cure: "restore it, or write it anew with sqlite3 FILE .dump".into(),
        };
        let mut header = [0; 100];
        match file.get(0, 100) {
            Ok(bytes) => header.copy_from_slice(bytes),
            Err(damage) => return Err(file.damaged(damage)),
        }
        let big =
            |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let page_size = match u64::from(u16::from_be_bytes([header[16], header[17]])) {
            1 => 65536,
            size => size,
        };
        let usable = page_size.saturating_sub(u64::from(header[20]));
        if !page_size.is_power_of_two() || page_size < 512 || usable < 480 {
            return Err(unsupported(&file, format!("pages of {page_size} bytes are no SQLite database")));
        }
        if big(56) > 1 {
            return Err(unsupported(&file, "its text is UTF-16, which no ROS recording has".into()));
        }
        let pages = file.end() / page_size;
        Ok(Self { file, page_size, usable, pages, stated_pages: u64::from(big(28)) })
    }

    /// The table with this name.
    pub fn table(&mut self, name: &str) -> Result<Option<Table>, Damage> {
        let mut found = None;
        self.rows(1, &mut |row| {
            let values = row.values(5)?;
            if let [Value::Text(kind), Value::Text(of), _, Value::Integer(root), Value::Text(sql)] =
                &values[..]
                && kind == "table"
                && of == name
            {
                found = u32::try_from(*root).ok().map(|root| Table { root, columns: columns(sql) });
            }
            Ok(())
        })
        .map_or(Ok(()), Err)?;
        Ok(found)
    }

    /// Visits the rows of a table in order; damaged pages and rows are skipped. Returns the first damage.
    pub fn rows(
        &mut self,
        root: u32,
        visit: &mut dyn FnMut(&mut Row) -> Result<(), Damage>,
    ) -> Option<Damage> {
        let mut seen = vec![false; self.pages as usize + 1];
        let mut first = None;
        self.tree(root, 0, &mut seen, visit, &mut first);
        first
    }

    fn tree(
        &mut self,
        page: u32,
        depth: usize,
        seen: &mut [bool],
        visit: &mut dyn FnMut(&mut Row) -> Result<(), Damage>,
        first: &mut Option<Damage>,
    ) {
        let at = u64::from(page.saturating_sub(1)) * self.page_size;
        let mut fail = |why: String| {
            first.get_or_insert(Damage::new(at, why));
        };
        match seen.get_mut(page as usize) {
            Some(seen) if page > 0 && !*seen && depth < MAX_DEPTH => *seen = true,
            None => return fail(format!("page {page} is missing")),
            _ => return fail(format!("page {page} is in the tree twice")),
        }
        let (kind, cells) = match self.cells(page) {
            Ok(cells) => cells,
            Err(damage) => return fail(damage.why),
        };
        for (number, cell) in cells.into_iter().enumerate() {
            let step = match kind {
                INTERIOR => match self.child(cell) {
                    Ok(child) => {
                        self.tree(child, depth + 1, seen, visit, first);
                        Ok(())
                    }
                    Err(damage) => Err(damage),
                },
                _ => self.row(page, number as u16, cell).and_then(|mut row| visit(&mut row)),
            };
            if let Err(damage) = step {
                first.get_or_insert(damage);
            }
        }
    }

    /// The type of a page and the positions of its cells; for an interior page the rightmost child comes last.
    fn cells(&mut self, page: u32) -> Result<(u8, Vec<u64>), Damage> {
        let start = u64::from(page.saturating_sub(1)) * self.page_size;
        let header = start + if page == 1 { 100 } else { 0 };
        let bytes = self.file.get(header, 12)?;
        let (kind, count) = (bytes[0], u64::from(u16::from_be_bytes([bytes[3], bytes[4]])));
        let size = match kind {
            LEAF => 8,
            INTERIOR => 12,
            other => return Err(Damage::new(start, format!("page {page} is of kind {other}"))),
        };
        if header - start + size + 2 * count > self.page_size {
            return Err(Damage::new(start, format!("page {page} states {count} cells")));
        }
        let pointers = self.file.get(header + size, 2 * count)?;
        let offset = |p: &[u8]| u64::from(u16::from_be_bytes([p[0], p[1]]));
        let mut cells: Vec<u64> = pointers.chunks_exact(2).map(|p| start + offset(p)).collect();
        if kind == INTERIOR {
            cells.push(header + 8);
        }
        Ok((kind, cells))
    }

    fn child(&mut self, cell: u64) -> Result<u32, Damage> {
        self.file.array(cell).map(u32::from_be_bytes)
    }

    /// A row of a leaf page.
    fn row(&mut self, page: u32, cell: u16, at: u64) -> Result<Row<'_>, Damage> {
        let (length, n) = self.varint(at)?;
        let (rowid, m) = self.varint(at + n)?;
        let at = at + n + m;
        let local = self.local(length);
        let overflow = if local < length { self.file.array(at + local).map(u32::from_be_bytes)? } else { 0 };
        let payload = Payload { length, at, local, overflow };
        Ok(Row { page, cell, rowid: rowid as i64, database: self, payload })
    }

    /// The row at a place from the index.
    pub fn row_at(&mut self, page: u32, cell: u16) -> Result<Row<'_>, Damage> {
        let (_, cells) = self.cells(page)?;
        let at = cells.get(usize::from(cell)).copied();
        let at = at.ok_or_else(|| Damage::new(0, format!("page {page} has no cell {cell}")))?;
        self.row(page, cell, at)
    }

    /// Number of payload bytes on the leaf page ("B-tree Cell Format").
    fn local(&self, length: u64) -> u64 {
        let most = self.usable - 35;
        if length <= most {
            return length;
        }
        let least = (self.usable - 12) * 32 / 255 - 23;
        let fitting = least + (length - least) % (self.usable - 4);
        if fitting <= most { fitting } else { least }
    }

    /// A varint of one to nine bytes, and its length.
    fn varint(&mut self, at: u64) -> Result<(u64, u64), Damage> {
        let mut value = 0u64;
        for i in 0..9 {
            let byte = self.file.get(at + i, 1)?[0];
            if i == 8 {
                return Ok((value << 8 | u64::from(byte), 9));
            }
            value = value << 7 | u64::from(byte & 0x7f);
            if byte & 0x80 == 0 {
                return Ok((value, i + 1));
            }
        }
        Ok((value, 9))
    }
}

impl Row<'_> {
    /// Reads `n` bytes of the row from `from`.
    pub fn bytes(&mut self, from: u64, n: u64) -> Result<Vec<u8>, Damage> {
        let Payload { length, at, local, mut overflow } = self.payload;
        let database = &mut *self.database;
        let cut = || Damage::new(at, format!("a row of {length} bytes is cut"));
        let end = from.checked_add(n).filter(|end| *end <= length && length <= database.file.end());
        let end = end.ok_or_else(cut)?;
        let mut out = Vec::with_capacity(n as usize);
        if from < local {
            let until = end.min(local);
            out.extend(database.file.read(at + from, until - from)?);
        }
        let mut start = local; // of the overflow page, in the payload
        let step = database.usable - 4;
        while start < end {
            if overflow == 0 || u64::from(overflow) > database.pages {
                return Err(cut());
            }
            let page = u64::from(overflow - 1) * database.page_size;
            let (first, last) = (from.max(start), end.min(start + step));
            if first < last {
                out.extend(database.file.read(page + 4 + (first - start), last - first)?);
            }
            overflow = database.file.array(page).map(u32::from_be_bytes)?;
            start += step;
        }
        Ok(out)
    }

    /// The first `most` values.
    pub fn values(&mut self, most: usize) -> Result<Vec<Value>, Damage> {
        let at = self.payload.at;
        let wrong = || Damage::new(at, "a row with a damaged header");
        // Row headers of the tables read here are short: at most 4 columns of 9 bytes, and the length.
        let head = self.bytes(0, self.payload.length.min(100))?;
        let (size, mut next) = varint(&head, 0).ok_or_else(wrong)?;
        let (mut body, mut out) = (size, Vec::new());
        while (next as u64) < size && out.len() < most {
            let (kind, after) = varint(&head, next).ok_or_else(wrong)?;
            next = after;
            let length = match kind {
                0 | 8 | 9 => 0,
                1..=4 => kind,
                5 => 6,
                6 | 7 => 8,
                10 | 11 => return Err(wrong()),
                _ => (kind - 12) / 2,
            };
            let value = match kind {
                0 | 7 => Value::Null, // fractions do not occur in what is read here
                8 => Value::Integer(0),
                9 => Value::Integer(1),
                1..=6 => Value::Integer(integer(&self.bytes(body, length)?)),
                _ if kind % 2 == 0 => Value::Blob(body, length),
                _ if length > MAX_TEXT => return Err(wrong()),
                _ => Value::Text(String::from_utf8_lossy(&self.bytes(body, length)?).into_owned()),
            };
            out.push(value);
            body = body.checked_add(length).ok_or_else(wrong)?;
        }
        Ok(out)
    }
}

fn varint(bytes: &[u8], mut at: usize) -> Option<(u64, usize)> {
    let mut value = 0u64;
    for i in 0..9 {
        let byte = *bytes.get(at)?;
        at += 1;
        if i == 8 {
            return Some((value << 8 | u64::from(byte), at));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            break;
        }
    }
    Some((value, at))
}

/// A signed big-endian number of one to eight bytes.
fn integer(bytes: &[u8]) -> i64 {
    let first = bytes.first().map_or(0, |b| i64::from(*b as i8));
    bytes.iter().skip(1).fold(first, |value, b| value << 8 | i64::from(*b))
}

/// The names of the columns in `CREATE TABLE name(a TYPE, b TYPE, ...)`.
fn columns(sql: &str) -> Vec<String> {
    let inside = sql.split_once('(').map_or("", |(_, rest)| rest);
    let mut depth = 0;
    let parts = inside.split(|c: char| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        c == ',' && depth == 0
    });
    let name = |part: &str| {
        let word = part.split_whitespace().next().unwrap_or("");
        word.trim_matches(|c| matches!(c, '"' | '`' | '[' | ']' | '\'')).to_owned()
    };
    parts.map(name).collect()
}
