//! Bytes of stored objects: numbers and slices one behind the other.

use bytemuck::{AnyBitPattern, NoUninit, Pod};

/// An object that a [`crate::StageStore`] can keep.
pub(crate) trait Stored: Sized {
    fn write(&self, writer: &mut Writer);
    /// `None` if these are not the bytes of such an object.
    fn read(reader: &mut Reader<'_>) -> Option<Self>;
}

/// The bytes of an object.
pub(crate) fn encode<T: Stored>(object: &T) -> Vec<u8> {
    let mut writer = Writer::default();
    object.write(&mut writer);
    writer.finish()
}

/// The object of these bytes; `None` if they are damaged.
pub(crate) fn decode<T: Stored>(bytes: &[u8]) -> Option<T> {
    let mut reader = Reader::new(bytes);
    let object = T::read(&mut reader)?;
    reader.is_at_end().then_some(object)
}

/// Writes the bytes of an object.
#[derive(Default)]
pub(crate) struct Writer(Vec<u8>);

impl Writer {
    fn finish(self) -> Vec<u8> {
        self.0
    }

    pub(super) fn number<T: NoUninit>(&mut self, number: T) {
        self.0.extend(bytemuck::bytes_of(&number));
    }

    pub(super) fn slice<T: NoUninit>(&mut self, items: &[T]) {
        self.number(items.len() as u64);
        self.0.extend(bytemuck::cast_slice::<T, u8>(items));
    }
}

/// Reads the bytes of an object.
pub(crate) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    fn is_at_end(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn number<T: AnyBitPattern>(&mut self) -> Option<T> {
        self.take(size_of::<T>()).map(bytemuck::pod_read_unaligned)
    }

    pub(super) fn flag(&mut self) -> Option<bool> {
        match self.number::<u8>()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    pub(super) fn slice<T: Pod>(&mut self) -> Option<Vec<T>> {
        let count = usize::try_from(self.number::<u64>()?).ok()?;
        Some(bytemuck::pod_collect_to_vec(self.take(count.checked_mul(size_of::<T>())?)?))
    }

    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }
}
