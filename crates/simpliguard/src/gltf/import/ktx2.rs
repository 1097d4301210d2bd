//! KTX2 images: Basis Universal (ETC1S and UASTC), and plain texels of 8 bits.
//!
//! The `basisu` crate decodes Basis Universal. The container is checked here first, and level 0 alone is decoded.
//! Levels with Zstandard compression are decompressed here, to the size that the header asks for.

use std::io::Read;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use image::RgbaImage;

/// Bytes in front of the level index.
const HEADER_BYTES: usize = 80;
/// Bytes of a level in the level index.
const LEVEL_BYTES: usize = 24;
/// Bytes of a UASTC block of 4 x 4 texels.
const UASTC_BLOCK_BYTES: usize = 16;

/// Supercompression schemes.
const UNCOMPRESSED: u32 = 0;
const BASIS_LZ: u32 = 1;
const ZSTANDARD: u32 = 2;

/// The layout of texels in a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Texels {
    Etc1s,
    Uastc,
    /// One byte for each of 3 or 4 channels.
    Plain {
        channels: usize,
    },
}

/// A KTX2 image whose header was checked.
#[derive(Debug)]
pub(super) struct Ktx2<'a> {
    bytes: &'a [u8],
    texels: Texels,
    scheme: u32,
    /// Bytes of level 0.
    level: Range<usize>,
    width: u32,
    height: u32,
}

impl<'a> Ktx2<'a> {
    /// Reads the header of an image of at most `longest` texels a side. The error says what was found.
    pub(super) fn new(bytes: &'a [u8], longest: u32) -> Result<Self, String> {
        let word = |at: usize| word(bytes, at).ok_or("its KTX2 header is truncated");
        let [width, height, depth, layers, faces] = [word(20)?, word(24)?, word(28)?, word(32)?, word(36)?];
        if width == 0 || height == 0 || width > longest || height > longest {
            return Err(format!("its KTX2 header says {width} x {height} texels"));
        }
        if depth != 0 || layers > 1 || faces != 1 {
            return Err("its KTX2 header says a volume, an array or a cube map".to_owned());
        }
        let scheme = word(44)?;
        let texels = texels(bytes, word(12)?)?;
        let fits = match texels {
            Texels::Etc1s => scheme == BASIS_LZ,
            Texels::Uastc | Texels::Plain { .. } => matches!(scheme, UNCOMPRESSED | ZSTANDARD),
        };
        if !fits {
            return Err(format!("its KTX2 header says the supercompression {scheme}, which is not read"));
        }
        let level = extent(bytes, HEADER_BYTES)?;
        let image = Self { bytes, texels, scheme, level, width, height };
        image.check_extents(word(40)?)?;
        Ok(image)
    }

    /// Width times height.
    pub(super) fn texel_count(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Decodes level 0. The error says what was found.
    pub(super) fn decode(&self) -> Result<RgbaImage, String> {
        // The decoder reports broken bytes. Should one make it panic after all, the file fails, and not the program.
        let texels = catch_unwind(AssertUnwindSafe(|| self.rgba()))
            .unwrap_or_else(|_| Err("its compressed texels are broken".to_owned()))?;
        RgbaImage::from_raw(self.width, self.height, texels).ok_or_else(|| "it has too few texels".to_owned())
    }

    /// Checks the extents of all levels and of the data that they share.
    fn check_extents(&self, levels: u32) -> Result<(), String> {
        const MOST_LEVELS: u32 = 16;
        if levels > MOST_LEVELS {
            return Err(format!("its KTX2 header says {levels} levels"));
        }
        for level in 0..levels as usize {
            extent(self.bytes, HEADER_BYTES + level * LEVEL_BYTES)?;
        }
        let needed = match self.texels {
            Texels::Etc1s => return extent(self.bytes, 64).map(drop),
            Texels::Uastc | Texels::Plain { .. } => self.level_bytes(),
        };
        if self.scheme == UNCOMPRESSED && self.level.len() < needed {
            return Err(format!("its first level holds {} of {needed} bytes", self.level.len()));
        }
        Ok(())
    }

    /// Bytes of level 0 without supercompression.
    fn level_bytes(&self) -> usize {
        match self.texels {
            Texels::Etc1s => 0,
            Texels::Uastc => self.width.div_ceil(4) as usize * self.height.div_ceil(4) as usize * UASTC_BLOCK_BYTES,
            Texels::Plain { channels } => self.texel_count() as usize * channels,
        }
    }

    fn rgba(&self) -> Result<Vec<u8>, String> {
        let inflated = match self.scheme {
            ZSTANDARD => Some(inflate(&self.bytes[self.level.clone()], self.level_bytes())?),
            _ => None,
        };
        let level = inflated.as_deref().unwrap_or(&self.bytes[self.level.clone()]);
        match self.texels {
            Texels::Etc1s => transcode(self.bytes),
            Texels::Uastc => transcode(&self.with_level(level)?),
            Texels::Plain { channels: 4 } => Ok(level[..self.level_bytes()].to_vec()),
            Texels::Plain { channels } => {
                let texels = level[..self.level_bytes()].chunks_exact(channels);
                Ok(texels.flat_map(|texel| [texel[0], texel[1], texel[2], u8::MAX]).collect())
            }
        }
    }

    /// The same image with `level` as its only level, without supercompression.
    fn with_level(&self, level: &[u8]) -> Result<Vec<u8>, String> {
        let descriptor = descriptor(self.bytes)?;
        let mut out = self.bytes[..HEADER_BYTES].to_vec();
        let mut put = |at: usize, bytes: &[u8]| out[at..at + bytes.len()].copy_from_slice(bytes);
        let start = HEADER_BYTES + LEVEL_BYTES;
        let data = (start + descriptor.len()).next_multiple_of(UASTC_BLOCK_BYTES);
        put(40, &1u32.to_le_bytes());
        put(44, &UNCOMPRESSED.to_le_bytes());
        put(48, &(start as u32).to_le_bytes());
        // No key-value data, and no data that levels share.
        put(56, &[0; 24]);
        let index = [data as u64, level.len() as u64, level.len() as u64];
        out.extend(index.iter().flat_map(|number| number.to_le_bytes()));
        out.extend_from_slice(descriptor);
        out.resize(data, 0);
        out.extend_from_slice(level);
        Ok(out)
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// The bytes at an offset and of a length, each a number of 64 bits at byte `at`.
fn extent(bytes: &[u8], at: usize) -> Result<Range<usize>, String> {
    let number = |at: usize| {
        let number = u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?);
        usize::try_from(number).ok()
    };
    let range = number(at).zip(number(at + 8)).and_then(|(start, length)| Some(start..start.checked_add(length)?));
    range.filter(|range| range.end <= bytes.len()).ok_or_else(|| "its KTX2 levels go past its end".to_owned())
}

/// The data format descriptor.
fn descriptor(bytes: &[u8]) -> Result<&[u8], String> {
    let range = word(bytes, 48).zip(word(bytes, 52));
    let range = range.and_then(|(start, length)| bytes.get(start as usize..)?.get(..length as usize));
    range.ok_or_else(|| "its KTX2 descriptor goes past its end".to_owned())
}

/// The layout that a Vulkan format means.
fn texels(bytes: &[u8], format: u32) -> Result<Texels, String> {
    /// Colour models of the descriptor.
    const ETC1S: u8 = 163;
    const UASTC: u8 = 166;
    match format {
        0 => match descriptor(bytes)?.get(12) {
            Some(&ETC1S) => Ok(Texels::Etc1s),
            Some(&UASTC) => Ok(Texels::Uastc),
            _ => Err("its KTX2 texels are neither ETC1S nor UASTC".to_owned()),
        },
        // R8G8B8 and R8G8B8A8, linear and sRGB.
        23 | 29 => Ok(Texels::Plain { channels: 3 }),
        37 | 43 => Ok(Texels::Plain { channels: 4 }),
        other => Err(format!("its KTX2 texels have the Vulkan format {other}, which is not read")),
    }
}

/// Decompresses `bytes` of Zstandard to exactly `length`.
fn inflate(bytes: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let broken = |why: String| format!("its Zstandard level is broken: {why}");
    let mut decoder = ruzstd::decoding::StreamingDecoder::new(bytes).map_err(|error| broken(error.to_string()))?;
    let mut out = vec![0; length];
    decoder.read_exact(&mut out).map_err(|error| broken(error.to_string()))?;
    Ok(out)
}

/// Level 0 of Basis Universal texels as RGBA.
fn transcode(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let broken = |error: basisu::Error| format!("its Basis Universal texels are broken: {error:?}");
    let transcoder = Transcoder::new(bytes).map_err(broken)?;
    transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(broken)
}
