//! A shared tier in object storage: Amazon S3 and what speaks its protocol, Google Cloud Storage, Azure Blob Storage.
//!
//! The layout is that of a cache's folder, but without a marker, because nothing is ever removed there. Credentials
//! come from the same environment variables that each provider's own tools read.

use std::ops::Range;

use blake3::Hash;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutMode, parse_url_opts};
use simpliguard_key::Key;
use tokio::runtime::{Builder, Runtime};
use url::Url;

use crate::folder::NAME;
use crate::tier::{Damaged, Tier};

/// Object storage at an address.
#[derive(Debug)]
pub(crate) struct Cloud {
    store: Box<dyn ObjectStore>,
    prefix: Path,
    runtime: Runtime,
}

impl Cloud {
    /// The storage at an address such as `s3://bucket/folder`.
    pub(crate) fn open(address: &str) -> Result<Self, String> {
        let url = Url::parse(address).map_err(|e| format!("it is no address: {e}"))?;
        let environment = std::env::vars().map(|(name, value)| (name.to_lowercase(), value));
        let (store, prefix) = parse_url_opts(&url, environment).map_err(|e| e.to_string())?;
        let runtime = Builder::new_current_thread().enable_all().build().map_err(|e| e.to_string())?;
        Ok(Self { store, prefix: prefix.join(NAME), runtime })
    }

    fn path(&self, folder: &str, hex: &str) -> Path {
        let (first, rest) = hex.split_at(2);
        self.prefix.clone().join(folder).join(first).join(rest)
    }

    fn object_path(&self, object: &Hash) -> Path {
        self.path("objects", &object.to_hex())
    }

    async fn read_record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, object_store::Error> {
        let Some(found) = if_there(self.store.get(&self.path("results", &key.hex())).await)? else { return Ok(None) };
        if found.meta.size > most {
            let source = format!("{} has {} bytes, over the limit of {most}", found.meta.location, found.meta.size);
            return Err(object_store::Error::Generic { store: "shared cache", source: source.into() });
        }
        found.bytes().await.map(|bytes| Some(bytes.into()))
    }
}

/// `None` if there is no such object.
fn if_there<T>(found: object_store::Result<T>) -> object_store::Result<Option<T>> {
    match found {
        Err(object_store::Error::NotFound { .. }) => Ok(None),
        found => found.map(Some),
    }
}

impl Tier for Cloud {
    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, String> {
        self.runtime.block_on(self.read_record(key, most)).map_err(|e| e.to_string())
    }

    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, String> {
        let path = self.object_path(object);
        let found = if_there(self.runtime.block_on(self.store.get_range(&path, bytes)));
        found.map(|part| part.map(Into::into)).map_err(|e| e.to_string())
    }

    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, String> {
        let found = if_there(self.runtime.block_on(self.store.head(&self.object_path(object))));
        found.map(|meta| meta.is_some_and(|meta| meta.size == size)).map_err(|e| e.to_string())
    }

    fn put_object(&self, object: &Hash, bytes: &[u8]) -> Result<(), String> {
        let (path, bytes) = (self.object_path(object), bytes.to_vec());
        match self.runtime.block_on(self.store.put_opts(&path, bytes.into(), PutMode::Create.into())) {
            Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
            Err(e) => Err(e.to_string()),
        }
    }

    fn put_record(&self, key: &Key, json: &[u8]) -> Result<(), String> {
        let (path, json) = (self.path("results", &key.hex()), json.to_vec());
        self.runtime.block_on(self.store.put(&path, json.into())).map(drop).map_err(|e| e.to_string())
    }

    /// Nothing is moved in object storage: a reader may have no right to do so.
    fn set_aside(&self, damaged: Damaged, reason: &str) -> String {
        let path = match damaged {
            Damaged::Record(key) => self.path("results", &key.hex()),
            Damaged::Object(hash) => self.object_path(&hash),
        };
        format!("{path} {reason}; remove it there")
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use simpliguard_key::{KeyBuilder, content_hash};

    use super::*;
    use crate::record::Entry;
    use crate::requests::{Failure, Patience, Requests};

    fn entry() -> Entry {
        Entry { objects: vec![("a".to_owned(), vec![7; 5 << 20]), ("b".to_owned(), b"content".to_vec())] }
    }

    #[test]
    fn what_was_stored_is_found_and_checked() {
        let cloud = Arc::new(Cloud::open("memory:///levels").expect("opens"));
        let tier: Arc<dyn Tier> = cloud.clone();
        let requests = Requests { tier: &tier, patience: Patience::default(), is_cancelled: &|| false };
        let key = KeyBuilder::new("test").finish();
        assert_eq!(requests.get(&key), Ok(None));
        // The second finds its objects there.
        for _ in 0..2 {
            requests.put(&key, entry()).expect("stores");
        }
        assert_eq!(requests.get(&key), Ok(Some(entry())));
        let object = cloud.path("objects", &content_hash(b"content").to_hex());
        for (damage, reason) in [(&b"rotten!"[..], "does not match its hash"), (b"rot", "has 3 bytes instead of 7")] {
            cloud.runtime.block_on(cloud.store.put(&object, damage.to_vec().into())).expect("stores");
            let found = requests.get(&key);
            assert!(matches!(&found, Err(Failure::Broken(found)) if found.contains(reason)), "{found:?}");
        }
        cloud.runtime.block_on(cloud.store.delete(&object)).expect("deletes");
        assert_eq!(requests.get(&key), Ok(None));
        assert!(cloud.record(&key, 10).is_err_and(|reason| reason.contains("over the limit of 10")));
    }

    #[test]
    fn addresses_that_name_no_storage_are_refused() {
        assert!(Cloud::open("ftp://levels").is_err());
        assert!(Cloud::open("no address").is_err());
    }
}
