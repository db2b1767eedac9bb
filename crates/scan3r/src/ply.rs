//! Annotated meshes: `labels.instances.annotated.v2.ply`, ASCII and binary little-endian.

use crate::Error;
use nalgebra::Point3;
use std::path::Path;

const MAX_HEADER: usize = 64 << 10;
const MAX_ROWS: u64 = 50_000_000;
const MAX_COLUMNS: usize = 64;

/// Vertices of an annotated mesh. Faces are skipped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnnotatedVertices {
    /// Metres, the scan's frame.
    pub points: Vec<Point3<f32>>,
    /// Property `objectId`; 0 = not annotated.
    pub instances: Vec<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of a field whose bytes are there (the caller checks the row's length).
    fn read(self, b: &[u8]) -> f64 {
        fn le<const N: usize>(b: &[u8]) -> [u8; N] {
            let mut a = [0; N];
            a.copy_from_slice(&b[..N]);
            a
        }
        match self {
            Self::I8 => f64::from(i8::from_le_bytes(le(b))),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes(le(b))),
            Self::U16 => f64::from(u16::from_le_bytes(le(b))),
            Self::I32 => f64::from(i32::from_le_bytes(le(b))),
            Self::U32 => f64::from(u32::from_le_bytes(le(b))),
            Self::F32 => f64::from(f32::from_le_bytes(le(b))),
            Self::F64 => f64::from_le_bytes(le(b)),
        }
    }
}

struct Header {
    ascii: bool,
    rows: usize,
    columns: Vec<(String, Kind)>,
    body: usize,
}

/// Reads the vertices.
///
/// # Errors
/// Another format, missing properties, counts that the file's length denies, numbers that are not
/// finite.
pub fn read_ply(bytes: &[u8], path: &Path) -> Result<AnnotatedVertices, Error> {
    let h = header(bytes, path)?;
    let column = |names: &[&str]| {
        names
            .iter()
            .find_map(|n| h.columns.iter().position(|(c, _)| c == n))
            .ok_or_else(|| Error::format(path, "header", format!("no property {}", names[0])))
    };
    let at = [column(&["x"])?, column(&["y"])?, column(&["z"])?, column(&["objectId", "label"])?];
    let body = &bytes[h.body..];
    let mut out = AnnotatedVertices::default();
    let mut push = |row: usize, v: [f64; 4]| {
        if v.iter().any(|x| !x.is_finite()) || v[3] < 0.0 {
            return Err(Error::format(path, format!("vertex {row}"), format!("{v:?}, want finite numbers")));
        }
        out.points.push(Point3::new(v[0] as f32, v[1] as f32, v[2] as f32));
        out.instances.push(v[3] as u32);
        Ok(())
    };
    if h.ascii {
        let text = std::str::from_utf8(body).map_err(|_| Error::format(path, "vertices", "not ASCII"))?;
        let mut lines = text.lines();
        for row in 0..h.rows {
            let line = lines
                .next()
                .ok_or_else(|| Error::format(path, format!("vertex {row}"), "the file is cut short"))?;
            let fields: Vec<&str> = line.split_ascii_whitespace().collect();
            let value = |k: usize| {
                fields.get(k).and_then(|f| f.parse().ok()).ok_or_else(|| {
                    Error::format(
                        path,
                        format!("vertex {row}"),
                        format!("field {} is no number", h.columns[k].0),
                    )
                })
            };
            push(row, [value(at[0])?, value(at[1])?, value(at[2])?, value(at[3])?])?;
        }
    } else {
        let mut offsets = Vec::new();
        let mut stride = 0;
        for (_, k) in &h.columns {
            offsets.push(stride);
            stride += k.size();
        }
        if body.len() / stride.max(1) < h.rows {
            let there = body.len() / stride.max(1);
            return Err(Error::format(
                path,
                "vertices",
                format!("{} announced, {there} there: the file is cut short", h.rows),
            ));
        }
        for (row, b) in body.chunks_exact(stride).take(h.rows).enumerate() {
            push(row, at.map(|k| h.columns[k].1.read(&b[offsets[k]..])))?;
        }
    }
    Ok(out)
}

fn header(bytes: &[u8], path: &Path) -> Result<Header, Error> {
    let bad = |problem: &str| Error::format(path, "header", problem);
    let head = &bytes[..bytes.len().min(MAX_HEADER)];
    const END: &[u8] = b"end_header";
    let end = head
        .windows(END.len())
        .position(|w| w == END)
        .ok_or_else(|| bad("no `end_header` in the first 64 KiB"))?;
    let newline =
        head[end..].iter().position(|&b| b == b'\n').ok_or_else(|| bad("no line end after `end_header`"))?;
    let text = std::str::from_utf8(&head[..end]).map_err(|_| bad("not ASCII"))?;
    let mut lines = text.lines();
    if lines.next().map(str::trim) != Some("ply") {
        return Err(bad("no `ply` in the first line"));
    }
    let mut h = Header { ascii: false, rows: 0, columns: Vec::new(), body: end + newline + 1 };
    let (mut inside, mut format, mut elements) = (false, false, 0);
    for line in lines {
        match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
            ["format", "ascii", _] => (h.ascii, format) = (true, true),
            ["format", "binary_little_endian", _] => (h.ascii, format) = (false, true),
            ["format", other, ..] => {
                return Err(bad(&format!("format {other}, want ascii or binary_little_endian")));
            }
            ["element", name, count] => {
                elements += 1;
                inside = name == "vertex";
                if inside && elements > 1 {
                    return Err(bad("the vertex element must come first"));
                }
                if inside {
                    let rows = count.parse::<u64>().ok().filter(|&n| n <= MAX_ROWS);
                    h.rows = rows.ok_or_else(|| bad(&format!("{count} vertices, want at most {MAX_ROWS}")))?
                        as usize;
                }
            }
            ["property", "list", ..] if inside => return Err(bad("a list among the vertex properties")),
            ["property", kind, name] if inside => {
                let kind = Kind::parse(kind).ok_or_else(|| bad(&format!("type {kind}")))?;
                if h.columns.len() == MAX_COLUMNS {
                    return Err(bad("more than 64 vertex properties"));
                }
                h.columns.push((name.to_owned(), kind));
            }
            _ => {}
        }
    }
    if format { Ok(h) } else { Err(bad("no `format` line")) }
}

/// An annotated mesh without faces, ASCII or binary, with the columns of 3RScan's files.
#[must_use]
pub fn write_ply(v: &AnnotatedVertices, ascii: bool) -> Vec<u8> {
    let format = if ascii { "ascii" } else { "binary_little_endian" };
    let mut out = format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty ushort objectId\n\
         element face 0\nproperty list uchar int vertex_indices\nend_header\n",
        v.points.len()
    )
    .into_bytes();
    for (p, &id) in v.points.iter().zip(&v.instances) {
        let hash = id.wrapping_mul(0x9E37_79B1);
        let [r, g, b, _] = hash.to_le_bytes();
        // The format has 16 bits for an instance id.
        let id = u16::try_from(id).unwrap_or(0);
        if ascii {
            out.extend(format!("{} {} {} {r} {g} {b} {id}\n", p.x, p.y, p.z).into_bytes());
        } else {
            out.extend([p.x, p.y, p.z].iter().flat_map(|c| c.to_le_bytes()));
            out.extend([r, g, b]);
            out.extend(id.to_le_bytes());
        }
    }
    out
}
