//! A shared tier in object storage: Amazon S3 and what speaks its protocol, Google Cloud Storage, Azure Blob Storage.
//!
//! The layout is that of a cache's folder, but without a marker, because nothing is ever removed there. Credentials
//! come from the same environment variables that each provider's own tools read.

use std::ops::Range;
use std::time::Duration;

use blake3::Hash;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, ObjectStoreScheme, PutMode, RetryConfig, parse_url};
use simpliguard_key::Key;
use tokio::runtime::{Builder, Runtime};
use url::Url;

use crate::folder::NAME;
use crate::tier::{Damaged, Fault, There, Tier};

/// The file that tells whether the storage can be used.
const PROBE: &str = "probe";
/// Codes of answers of S3, Azure and GCS for a bucket that does not exist.
const NO_BUCKET: [&str; 3] = ["NoSuchBucket", "ContainerNotFound", "The specified bucket does not exist"];

/// Most tries of a request after the first, and the time for all of them.
const RETRIES: usize = 3;
const RETRY_TIME: Duration = Duration::from_secs(10);

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
        let (store, prefix) = connect(&url).map_err(|e| e.to_string())?;
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

    async fn read_record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        let Some(found) = if_there(self.store.get(&self.path("results", &key.hex())).await)? else { return Ok(None) };
        if found.meta.size > most {
            let found = format!("{} has {} bytes, over the limit of {most}", found.meta.location, found.meta.size);
            return Err(Fault::Failed(found));
        }
        Ok(Some(found.bytes().await.map_err(fault)?.into()))
    }

    /// Stores a file. With [`There::Equal`] it is created, so that of several writers at the same time only one writes.
    fn put(&self, path: &Path, bytes: &[u8], there: There) -> Result<(), Fault> {
        let mode = if there == There::Equal { PutMode::Create } else { PutMode::Overwrite };
        match self.runtime.block_on(self.store.put_opts(path, bytes.to_vec().into(), mode.into())) {
            Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
            Err(e) => Err(fault(e)),
        }
    }
}

/// The storage of a URL and the folder in it, with options from the environment.
fn connect(url: &Url) -> object_store::Result<(Box<dyn ObjectStore>, Path)> {
    let (scheme, path) = ObjectStoreScheme::parse(url)?;
    let retry = RetryConfig { max_retries: RETRIES, retry_timeout: RETRY_TIME, ..RetryConfig::default() };
    macro_rules! build {
        ($builder:ty) => {{
            let builder = <$builder>::new().with_url(url.as_str()).with_retry(retry);
            let set = |builder: $builder, (name, value): (String, String)| match name.parse() {
                Ok(option) => builder.with_config(option, value),
                Err(_) => builder,
            };
            Box::new(environment().fold(builder, set).build()?) as Box<dyn ObjectStore>
        }};
    }
    let store = match scheme {
        ObjectStoreScheme::AmazonS3 => build!(AmazonS3Builder),
        ObjectStoreScheme::GoogleCloudStorage => build!(GoogleCloudStorageBuilder),
        ObjectStoreScheme::MicrosoftAzure => build!(MicrosoftAzureBuilder),
        _ => return parse_url(url),
    };
    Ok((store, Path::parse(path)?))
}

/// The variables that the tools of the providers read, in lower case. Others may have the name of an option, too.
fn environment() -> impl Iterator<Item = (String, String)> {
    let variables = std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value)));
    let named = variables.map(|(name, value)| (name.to_lowercase(), value));
    let known = named.filter(|(name, _)| ["aws_", "google_", "azure_"].iter().any(|prefix| name.starts_with(prefix)));
    known.filter_map(|(name, value)| Some((name, value.into_string().ok()?)))
}

/// `None` if there is no such object in the bucket.
fn if_there<T>(found: object_store::Result<T>) -> Result<Option<T>, Fault> {
    match found {
        Err(e @ object_store::Error::NotFound { .. }) => match fault(e) {
            Fault::Failed(_) => Ok(None),
            fault => Err(fault),
        },
        found => found.map(Some).map_err(fault),
    }
}

fn fault(error: object_store::Error) -> Fault {
    use object_store::Error;
    let text = error.to_string();
    match error {
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => Fault::Denied(text),
        // A bucket that is missing must not look like an empty cache. Each provider has a word of its own for it.
        Error::NotFound { .. } if NO_BUCKET.iter().any(|word| text.contains(word)) => {
            Fault::NoPlace("there is no such bucket".into())
        }
        _ => Fault::Failed(text),
    }
}

impl Tier for Cloud {
    fn probe(&self, write: bool) -> Result<(), Fault> {
        let path = self.prefix.clone().join(PROBE);
        // The answer to a GET has a body, which says whether the file or the bucket is missing.
        if_there(self.runtime.block_on(self.store.get(&path)))?;
        if write { self.put(&path, b"", There::Bad) } else { Ok(()) }
    }

    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        self.runtime.block_on(self.read_record(key, most))
    }

    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, Fault> {
        let path = self.object_path(object);
        let found = if_there(self.runtime.block_on(self.store.get_range(&path, bytes)))?;
        Ok(found.map(Into::into))
    }

    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, Fault> {
        let found = if_there(self.runtime.block_on(self.store.head(&self.object_path(object))))?;
        Ok(found.is_some_and(|meta| meta.size == size))
    }

    fn put_object(&self, object: &Hash, bytes: &[u8], there: There) -> Result<(), Fault> {
        self.put(&self.object_path(object), bytes, there)
    }

    fn put_record(&self, key: &Key, json: &[u8], there: There) -> Result<(), Fault> {
        self.put(&self.path("results", &key.hex()), json, there)
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
    use crate::counters::Tally;
    use crate::record::Entry;
    use crate::requests::{Failure, Found, Patience, Requests};
    use crate::signature::Trust;

    fn entry() -> Entry {
        Entry { objects: vec![("a".to_owned(), vec![7; 5 << 20]), ("b".to_owned(), b"content".to_vec())] }
    }

    #[test]
    fn what_was_stored_is_found_and_checked() {
        let cloud = Arc::new(Cloud::open("memory:///levels").expect("opens"));
        let tier: Arc<dyn Tier> = cloud.clone();
        let (trust, tally) = (Trust::default(), Tally::default());
        let requests = Requests {
            tier: &tier,
            patience: Patience::default(),
            trust: &trust,
            tally: &tally,
            replace: &|_| {},
            is_cancelled: &|| false,
        };
        let key = KeyBuilder::new("test").finish();
        let get =
            || requests.get(&key).map(|found| if let Found::Something(entry) = found { Some(entry) } else { None });
        assert_eq!(get(), Ok(None));
        // The second finds its objects there.
        for _ in 0..2 {
            requests.put(&key, entry(), |_| There::Equal).expect("stores");
        }
        assert_eq!(get(), Ok(Some(entry())));
        let object = cloud.path("objects", &content_hash(b"content").to_hex());
        for (damage, reason) in [(&b"rotten!"[..], "does not match its hash"), (b"rot", "has 3 bytes instead of 7")] {
            cloud.runtime.block_on(cloud.store.put(&object, damage.to_vec().into())).expect("stores");
            let found = get();
            assert!(matches!(&found, Err(Failure::Damaged(found)) if found.contains(reason)), "{found:?}");
        }
        cloud.runtime.block_on(cloud.store.delete(&object)).expect("deletes");
        assert_eq!(get(), Ok(None));
        assert!(matches!(cloud.record(&key, 10), Err(Fault::Failed(found)) if found.contains("over the limit of 10")));
    }

    #[test]
    fn addresses_that_name_no_storage_are_refused() {
        assert!(Cloud::open("ftp://levels").is_err());
        assert!(Cloud::open("no address").is_err());
    }
}
