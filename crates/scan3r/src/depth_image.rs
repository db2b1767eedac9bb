//! 16-bit depth images: binary PGM (3RScan) and grey PNG (7-Scenes, TUM, ScanNet exports).

use crate::Error;
use crate::frame::MAX_SIDE;
use std::io::Cursor;
use std::path::Path;

/// Raw samples of a depth image, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DepthImage {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values as stored.
    pub samples: Vec<u16>,
}

impl DepthImage {
    /// Metres: sample / `per_metre`; 0 and 65535 are no measurement and become 0.
    #[must_use]
    pub fn metres(&self, per_metre: f32) -> Vec<f32> {
        self.samples.iter().map(|&s| if s == u16::MAX { 0.0 } else { f32::from(s) / per_metre }).collect()
    }
}

/// Reads a binary PGM. With a maximum above 255 its samples are big-endian pairs of bytes.
///
/// # Errors
/// Another format, sides beyond 4096, missing bytes.
pub fn read_pgm(bytes: &[u8], path: &Path) -> Result<DepthImage, Error> {
    let bad = |field: &str, problem: String| Error::format(path, field, problem);
    let mut at = 0;
    let mut token = || -> Option<&[u8]> {
        loop {
            while bytes.get(at)?.is_ascii_whitespace() {
                at += 1;
            }
            if bytes[at] != b'#' {
                break;
            }
            while *bytes.get(at)? != b'\n' {
                at += 1;
            }
        }
        let start = at;
        while bytes.get(at).is_some_and(|b| !b.is_ascii_whitespace()) {
            at += 1;
        }
        Some(&bytes[start..at])
    };
    if token() != Some(b"P5") {
        return Err(bad("header", "no binary PGM (P5)".into()));
    }
    let mut number = |field: &'static str, max: u32| {
        let t = token().and_then(|t| std::str::from_utf8(t).ok()).unwrap_or("");
        t.parse::<u32>()
            .ok()
            .filter(|v| (1..=max).contains(v))
            .ok_or_else(|| bad(field, format!("{t:?}, want 1 to {max}")))
    };
    let (width, height) = (number("width", MAX_SIDE)?, number("height", MAX_SIDE)?);
    let max = number("maximum", 65535)?;
    let body = bytes.get(at + 1..).unwrap_or(&[]);
    let n = width as usize * height as usize;
    let need = if max > 255 { 2 * n } else { n };
    if body.len() < need {
        return Err(bad("samples", format!("{} bytes, want {need}: the file is cut short", body.len())));
    }
    let samples = if max > 255 {
        body[..need].as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect()
    } else {
        body[..need].iter().map(|&b| u16::from(b)).collect()
    };
    Ok(DepthImage { width, height, samples })
}

/// A binary PGM with maximum 65535.
#[must_use]
pub fn write_pgm(image: &DepthImage) -> Vec<u8> {
    let mut out = format!("P5\n{} {}\n65535\n", image.width, image.height).into_bytes();
    out.extend(image.samples.iter().flat_map(|s| s.to_be_bytes()));
    out
}

/// Reads a 16-bit grey PNG.
///
/// # Errors
/// Another colour type or depth, sides beyond 4096, damaged data.
pub fn read_png(bytes: &[u8], path: &Path) -> Result<DepthImage, Error> {
    let bad = |problem: String| Error::format(path, "PNG", problem);
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 128 << 20 });
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(|e| bad(e.to_string()))?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    if info.color_type != png::ColorType::Grayscale || info.bit_depth != png::BitDepth::Sixteen {
        return Err(bad(format!("{:?} {:?}, want 16-bit grey depth", info.color_type, info.bit_depth)));
    }
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(bad(format!("{width} x {height} pixels, want at most {MAX_SIDE} a side")));
    }
    let mut raw = vec![0; width as usize * height as usize * 2];
    reader.next_frame(&mut raw).map_err(|e| bad(e.to_string()))?;
    let samples = raw.as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect();
    Ok(DepthImage { width, height, samples })
}

/// A 16-bit grey PNG.
///
/// # Errors
/// A number of samples that is not width x height.
pub fn write_png(image: &DepthImage) -> Result<Vec<u8>, Error> {
    let bad = |e: png::EncodingError| Error::Value { field: "image", problem: e.to_string() };
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, image.width, image.height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().map_err(bad)?;
    let raw: Vec<u8> = image.samples.iter().flat_map(|s| s.to_be_bytes()).collect();
    writer.write_image_data(&raw).map_err(bad)?;
    writer.finish().map_err(bad)?;
    Ok(out)
}
