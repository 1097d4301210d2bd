//! A shared tier in object storage: Amazon S3 and what speaks its protocol, Google Cloud Storage, Azure Blob Storage.
//!
//! The layout is that of a cache's folder, but without a marker, because nothing is ever removed there. Credentials
//! come from the same environment variables that each provider's own tools read.

use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutMode, parse_url_opts};
use simpliguard_key::{Key, content_hash};
use tokio::runtime::{Builder, Runtime};
use url::Url;

use crate::folder::NAME;
use crate::record::{Entry, ObjectRecord, Record};
use crate::shared::Tier;

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

    async fn read(&self, folder: &str, hex: &str) -> Result<Option<Vec<u8>>, String> {
        let found = match self.store.get(&self.path(folder, hex)).await {
            Ok(found) => found,
            Err(object_store::Error::NotFound { .. }) => return Ok(None),
            Err(e) => return Err(e.to_string()),
        };
        found.bytes().await.map(|bytes| Some(bytes.into())).map_err(|e| e.to_string())
    }

    async fn read_result(&self, key: &Key) -> Result<Option<Entry>, String> {
        let Some(json) = self.read("results", &key.hex()).await? else { return Ok(None) };
        let damaged = |what: &str, reason: String| format!("{what} {reason}; remove it there");
        let record = Record::parse(&json, &key.hex()).map_err(|reason| damaged(&key.hex(), reason))?;
        let Some(record) = record else { return Ok(None) };
        let mut objects = Vec::with_capacity(record.objects.len());
        for ObjectRecord { name, hash, size } in record.objects {
            let hex = hash.to_hex();
            let Some(bytes) = self.read("objects", &hex).await? else { return Ok(None) };
            if bytes.len() as u64 != size || content_hash(&bytes) != hash {
                return Err(damaged(&hex, "does not match its hash".into()));
            }
            objects.push((name, bytes));
        }
        Ok(Some(Entry { objects }))
    }

    async fn write_result(&self, key: &Key, entry: &Entry) -> Result<(), String> {
        let mut objects = Vec::with_capacity(entry.objects.len());
        for (name, bytes) in &entry.objects {
            let hash = content_hash(bytes);
            let path = self.path("objects", &hash.to_hex());
            match self.store.put_opts(&path, bytes.clone().into(), PutMode::Create.into()).await {
                Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => {}
                Err(e) => return Err(e.to_string()),
            }
            objects.push(ObjectRecord { name: name.clone(), hash, size: bytes.len() as u64 });
        }
        let json = Record::new(key, objects).to_json().map_err(|e| e.to_string())?;
        let path = self.path("results", &key.hex());
        self.store.put(&path, json.into()).await.map(drop).map_err(|e| e.to_string())
    }
}

impl Tier for Cloud {
    fn get(&self, key: &Key) -> Result<Option<Entry>, String> {
        self.runtime.block_on(self.read_result(key))
    }

    fn put(&self, key: &Key, entry: &Entry) -> Result<(), String> {
        self.runtime.block_on(self.write_result(key, entry))
    }
}

#[cfg(test)]
mod tests {
    use simpliguard_key::KeyBuilder;

    use super::*;

    fn entry() -> Entry {
        let objects = vec![("a".to_owned(), vec![7; 3000]), ("b".to_owned(), b"content".to_vec())];
        Entry { objects }
    }

    #[test]
    fn what_was_stored_is_found_and_checked() {
        let cloud = Cloud::open("memory:///levels").expect("opens");
        let key = KeyBuilder::new("test").finish();
        assert_eq!(cloud.get(&key), Ok(None));
        // The second finds its objects there.
        for _ in 0..2 {
            cloud.put(&key, &entry()).expect("stores");
        }
        assert_eq!(cloud.get(&key), Ok(Some(entry())));
        let object = cloud.path("objects", &content_hash(b"content").to_hex());
        cloud.runtime.block_on(cloud.store.put(&object, b"rot".to_vec().into())).expect("stores");
        assert!(cloud.get(&key).is_err_and(|reason| reason.contains("does not match its hash")));
        cloud.runtime.block_on(cloud.store.delete(&object)).expect("deletes");
        assert_eq!(cloud.get(&key), Ok(None));
    }

    #[test]
    fn addresses_that_name_no_storage_are_refused() {
        assert!(Cloud::open("ftp://levels").is_err());
        assert!(Cloud::open("no address").is_err());
    }
}
