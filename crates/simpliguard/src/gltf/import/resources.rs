//! The bytes that a glTF refers to: BIN chunk, `data:` URIs and files beside the model.

use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use bytes::Bytes;

use super::asset::Asset;
use super::schema::Root;
use crate::source::percent_decode;
use crate::{Error, RelativeUri, Source, StageId};

/// Reads URIs and counts the bytes.
pub(super) struct Loader<'a> {
    pub(super) asset: Asset<'a>,
    source: &'a Source<'a>,
    total: u64,
}

/// An image of the file: in a buffer view, or given by URI, with its encoded bytes and MIME type or the reason why it
/// could not be read.
#[derive(Debug)]
pub(super) enum SourceImage {
    InBuffer,
    Read {
        uri: String,
        bytes: Bytes,
        mime: &'static str,
    },
    Failed {
        uri: String,
        reason: String,
    },
    /// It was read, but is of a kind that should have been decoded by now.
    Undecodable {
        reason: String,
    },
}

impl SourceImage {
    /// Bytes and MIME type, if the image was given by URI and read.
    pub(super) fn into_bytes(self) -> Option<(Bytes, &'static str)> {
        match self {
            Self::Read { bytes, mime, .. } => Some((bytes, mime)),
            Self::InBuffer | Self::Failed { .. } | Self::Undecodable { .. } => None,
        }
    }
}

impl<'a> Loader<'a> {
    pub(super) fn new(asset: Asset<'a>, source: &'a Source<'a>) -> Self {
        Self { asset, source, total: source.bytes.len() as u64 }
    }

    /// All buffers, each at least as long as it says. A buffer with neither a URI nor a BIN chunk is empty;
    /// [`check_complete`] reports it if the model needs it.
    pub(super) fn buffers(&mut self, root: &Root<'_>, mut bin: Option<Bytes>) -> Result<Vec<Bytes>, Error> {
        let mut out = Vec::with_capacity(root.buffers.len());
        for (index, buffer) in root.buffers.iter().enumerate() {
            let bytes = match buffer.uri {
                Some(uri) => self.read(uri)?.map_err(|reason| resource_error(self.asset, uri, reason))?,
                None if index == 0 && bin.is_some() => bin.take().unwrap_or_default(),
                None => {
                    out.push(Bytes::new());
                    continue;
                }
            };
            if bytes.len() < buffer.byte_length {
                let (found, needed) = (bytes.len(), buffer.byte_length);
                return Err(self
                    .asset
                    .invalid(format!("buffer {index} should hold {needed} bytes, but holds {found}")));
            }
            out.push(bytes);
        }
        Ok(out)
    }

    /// All images. An image that cannot be read becomes an error only when a material refers to it.
    pub(super) fn images(&mut self, root: &Root<'_>) -> Result<Vec<SourceImage>, Error> {
        let mut out = Vec::with_capacity(root.images.len());
        for image in &root.images {
            let Some(uri) = image.uri else {
                out.push(SourceImage::InBuffer);
                continue;
            };
            let found = self.read(uri)?.and_then(|bytes| match mime_of(&bytes) {
                Some(mime) => Ok((bytes, mime)),
                None => Err("it is no PNG, JPEG, WebP, KTX2 or DDS image".to_owned()),
            });
            out.push(match found {
                Ok((bytes, mime)) => SourceImage::Read { uri: shortened(uri), bytes, mime },
                Err(reason) => SourceImage::Failed { uri: shortened(uri), reason },
            });
        }
        Ok(out)
    }

    /// The bytes at `uri`. The inner error is the reason why they cannot be read, the outer one a limit.
    fn read(&mut self, uri: &str) -> Result<Result<Bytes, String>, Error> {
        let bytes = if is_data_uri(uri) {
            self.count(uri.len())?;
            data_uri(uri)
        } else {
            let read = RelativeUri::parse(uri)
                .map_err(|rule| format!("the URI is refused: {rule}"))
                .and_then(|path| self.source.resources.read(&path));
            self.count(read.as_ref().map_or(0, Bytes::len))?;
            read
        };
        Ok(bytes)
    }

    fn count(&mut self, bytes: usize) -> Result<(), Error> {
        self.total = self.total.saturating_add(bytes as u64);
        self.asset.allocate("what it refers to", bytes as u64)?;
        self.asset.within(
            "the size in bytes of the file and what it refers to",
            self.total as usize,
            self.asset.limits.bytes,
        )
    }
}

/// Notes for the report: images that could not be read, and that no material refers to.
pub(super) fn unread_images(images: &[SourceImage]) -> Vec<String> {
    let note = |(image, external): (usize, &SourceImage)| match external {
        SourceImage::Failed { uri, reason } => Some(format!("unused image {image} '{uri}' is left out: {reason}")),
        SourceImage::Undecodable { reason } => Some(format!("unused image {image} is left as it is: {reason}")),
        SourceImage::InBuffer | SourceImage::Read { .. } => None,
    };
    images.iter().enumerate().filter_map(note).collect()
}

/// `Err` if a buffer is shorter than it says.
pub(super) fn check_complete(asset: Asset<'_>, root: &Root<'_>, buffers: &[Bytes]) -> Result<(), Error> {
    match root.buffers.iter().zip(buffers).position(|(buffer, bytes)| bytes.len() < buffer.byte_length) {
        Some(index) => Err(asset.invalid(format!("buffer {index} has neither a URI nor a BIN chunk"))),
        None => Ok(()),
    }
}

/// The error for a needed file that cannot be read.
pub(super) fn resource_error(asset: Asset<'_>, uri: &str, reason: String) -> Error {
    Error::Resource { asset: asset.name.to_owned(), stage: StageId::Import, uri: shortened(uri), reason }
}

/// A URI for a message, cut to 120 characters: `data:` URIs can be megabytes long.
fn shortened(uri: &str) -> String {
    const LONGEST: usize = 120;
    if uri.chars().count() <= LONGEST {
        uri.to_owned()
    } else {
        uri.chars().take(LONGEST).chain("...".chars()).collect()
    }
}

fn is_data_uri(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// Decodes `data:[type];base64,...` and `data:[type],...`.
fn data_uri(uri: &str) -> Result<Bytes, String> {
    const LENIENT: GeneralPurpose = GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true),
    );
    let (header, payload) = uri.split_once(',').ok_or("the data URI has no comma")?;
    let decoded = if header.ends_with(";base64") {
        LENIENT.decode(payload).map_err(|error| error.to_string())
    } else {
        percent_decode(payload)
    };
    decoded.map(Bytes::from).map_err(|error| format!("the data URI is broken: {error}"))
}

/// The MIME type of an encoded image, by its first bytes.
pub(super) fn mime_of(bytes: &[u8]) -> Option<&'static str> {
    Some(match bytes {
        [0x89, b'P', b'N', b'G', ..] => "image/png",
        [0xFF, 0xD8, 0xFF, ..] => "image/jpeg",
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "image/webp",
        [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', 0xBB, ..] => "image/ktx2",
        [b'D', b'D', b'S', b' ', ..] => "image/vnd-ms.dds",
        _ => return None,
    })
}
