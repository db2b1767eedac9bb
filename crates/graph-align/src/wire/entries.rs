//! Frames that name entries: retractions, and what a peer need not ask for.

use super::bits::{Reader, Writer};
use super::{DELTA, GONE, RETRACTION, head, only_way, open, put_key, read_key};
use crate::{Error, Key, Retraction, Vocabulary};

/// Shortest way to write a key, bytes.
const KEY_BYTES: usize = 4;
/// Most keys of a frame.
pub const MAX_KEYS: usize = 1 << 16;

/// What a frame holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A whole observation ([`super::decode`]).
    Observation,
    /// What changed since one ([`super::decode_delta`]).
    Delta,
    /// A retraction ([`decode_retraction`]).
    Retraction,
    /// Entries that no longer count ([`decode_gone`]).
    Gone,
}

/// What a frame holds, by its flags; the rest of it is not looked at.
///
/// # Errors
/// No frame of this vocabulary.
pub fn kind(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Kind, Error> {
    let (flags, _) = open(bytes, vocabulary)?;
    Ok(match flags {
        RETRACTION => Kind::Retraction,
        GONE => Kind::Gone,
        f if f & DELTA != 0 => Kind::Delta,
        _ => Kind::Observation,
    })
}

/// A retraction as bytes.
///
/// # Errors
/// More than [`MAX_KEYS`] keys.
pub fn encode_retraction(r: &Retraction, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    let mut w = Writer::default();
    head(&mut w, RETRACTION, vocabulary);
    put_key(&mut w, &r.key);
    put_keys(w, &r.of)
}

/// Reads [`encode_retraction`].
///
/// # Errors
/// Anything that it would not write.
pub fn decode_retraction(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Retraction, Error> {
    let mut r = open_as(bytes, RETRACTION, vocabulary)?;
    let out = Retraction { key: read_key(&mut r)?, of: read_keys(&mut r, bytes.len())? };
    only_way(&encode_retraction(&out, vocabulary)?, bytes)?;
    Ok(out)
}

/// [`Beyond::gone`](crate::Beyond::gone) as bytes.
///
/// # Errors
/// More than [`MAX_KEYS`] keys.
pub fn encode_gone(gone: &[Key], vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    let mut w = Writer::default();
    head(&mut w, GONE, vocabulary);
    put_keys(w, gone)
}

/// Reads [`encode_gone`].
///
/// # Errors
/// Anything that it would not write.
pub fn decode_gone(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Vec<Key>, Error> {
    let mut r = open_as(bytes, GONE, vocabulary)?;
    let out = read_keys(&mut r, bytes.len())?;
    only_way(&encode_gone(&out, vocabulary)?, bytes)?;
    Ok(out)
}

fn open_as<'a>(bytes: &'a [u8], wanted: u8, vocabulary: &Vocabulary) -> Result<Reader<'a>, Error> {
    let (flags, r) = open(bytes, vocabulary)?;
    if flags == wanted { Ok(r) } else { Err(r.bad(format!("flags {flags:#x}, want {wanted:#x}"))) }
}

fn put_keys(mut w: Writer<'_>, keys: &[Key]) -> Result<Vec<u8>, Error> {
    if keys.len() > MAX_KEYS {
        return Err(Error::value("keys", format!("{}, want at most {MAX_KEYS}", keys.len())));
    }
    w.number(keys.len() as u64);
    keys.iter().for_each(|k| put_key(&mut w, k));
    Ok(w.finish())
}

fn read_keys(r: &mut Reader<'_>, bytes: usize) -> Result<Vec<Key>, Error> {
    let n = r.count(MAX_KEYS, bytes / KEY_BYTES)?;
    (0..n).map(|_| read_key(r)).collect()
}
