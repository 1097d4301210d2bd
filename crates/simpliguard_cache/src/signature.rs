//! Signatures of records: who vouches for the results of a shared tier.
//!
//! Hashes find damage, but whoever can write to a shared tier can also write hashes. A machine with a secret key signs the
//! records that it stores. A machine with trusted keys uses only records with a signature of one of them.

use std::fmt;

use ed25519_dalek::{Signature as Ed25519, Signer, SigningKey, VerifyingKey};

use crate::record::{ObjectRecord, Record, Signature};

/// The first line of what is signed, so that a signature for something else is none for a record.
const CONTEXT: &str = "simpliguard record 1\n";

/// A public key of Ed25519, as 64 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublicKey(VerifyingKey);

/// A secret key of Ed25519. It signs the records that a machine stores in a shared tier.
#[derive(Clone)]
pub struct SecretKey(SigningKey);

/// The keys of a machine.
#[derive(Clone, Debug, Default)]
pub struct Trust {
    /// Only records that one of these has signed are used. Empty: every record is used.
    pub trusted: Vec<PublicKey>,
    /// Signs the records that this machine stores.
    pub signer: Option<SecretKey>,
}

impl PublicKey {
    /// The key that [`fmt::Display`] writes.
    ///
    /// # Errors
    /// A description of what is wrong with the text.
    pub fn parse(hex: &str) -> Result<Self, String> {
        let bytes = bytes_of::<32>(hex).ok_or("a public key has 64 hexadecimal digits")?;
        VerifyingKey::from_bytes(&bytes).map(Self).map_err(|_| "it is no public key of Ed25519".to_owned())
    }
}

impl fmt::Display for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&hex_of(self.0.as_bytes()))
    }
}

impl SecretKey {
    /// The key of 32 random bytes.
    pub fn from_bytes(bytes: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(bytes))
    }

    /// The key of 64 hexadecimal digits; white space around them counts for nothing.
    ///
    /// # Errors
    /// A description of what is wrong. It does not show the text.
    pub fn parse(hex: &str) -> Result<Self, String> {
        let bytes = bytes_of::<32>(hex.trim()).ok_or("a secret key has 64 hexadecimal digits")?;
        Ok(Self::from_bytes(&bytes))
    }

    /// The text that [`Self::parse`] reads. It must stay secret.
    pub fn to_hex(&self) -> String {
        hex_of(self.0.as_bytes())
    }

    /// The key that others trust.
    pub fn public(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }
}

impl fmt::Debug for SecretKey {
    /// Shows the public key: a secret has no place in a log.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SecretKey of {}", self.public())
    }
}

impl Trust {
    /// The record with a signature, if this machine signs.
    pub(crate) fn sign(&self, record: Record) -> Record {
        let signature = self.signer.as_ref().map(|secret| Signature {
            key: secret.public().to_string(),
            signature: hex_of(&secret.0.sign(message(&record).as_bytes()).to_bytes()),
        });
        record.with_signature(signature)
    }

    /// Tells whether a record may be used.
    pub(crate) fn accepts(&self, record: &Record) -> bool {
        self.trusted.is_empty() || self.is_signed(record).is_some()
    }

    fn is_signed(&self, record: &Record) -> Option<()> {
        let Signature { key, signature } = record.signature.as_ref()?;
        let key = PublicKey::parse(key).ok().filter(|key| self.trusted.contains(key))?;
        let signature = Ed25519::from_bytes(&bytes_of::<64>(signature)?);
        key.0.verify_strict(message(record).as_bytes(), &signature).ok()
    }
}

/// What is signed: the key of the result, and names, hashes and sizes of its objects. A name has no line break.
fn message(record: &Record) -> String {
    let object = |o: &ObjectRecord| format!("{} {} {}\n", o.hash.to_hex(), o.size, o.name);
    format!("{CONTEXT}{}\n{}", record.key, record.objects.iter().map(object).collect::<String>())
}

fn hex_of(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes_of<const N: usize>(hex: &str) -> Option<[u8; N]> {
    if hex.len() != 2 * N || !hex.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut bytes = [0; N];
    for (byte, digits) in bytes.iter_mut().zip(hex.as_bytes().chunks(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use simpliguard_key::{KeyBuilder, content_hash};

    use super::*;

    fn record(name: &str) -> Record {
        let object = ObjectRecord { name: "a".into(), hash: content_hash(b"content"), size: 7 };
        Record::new(&KeyBuilder::new(name).finish(), vec![object])
    }

    #[test]
    fn only_signatures_of_trusted_keys_count() {
        let [build, stranger] = [1, 2].map(|byte| SecretKey::from_bytes(&[byte; 32]));
        let signs = |secret: &SecretKey| Trust { signer: Some(secret.clone()), trusted: Vec::new() };
        let trust = Trust { trusted: vec![build.public()], signer: None };
        assert!(trust.accepts(&signs(&build).sign(record("k"))));
        assert!(!trust.accepts(&signs(&stranger).sign(record("k"))));
        assert!(!trust.accepts(&record("k")));
        // A signature holds for one record.
        let signature = signs(&build).sign(record("k")).signature;
        assert!(!trust.accepts(&record("other").with_signature(signature.clone())));
        let mut changed = record("k").with_signature(signature);
        changed.objects[0].hash = content_hash(b"another");
        assert!(!trust.accepts(&changed));
        assert!(Trust::default().accepts(&record("k")));
    }

    #[test]
    fn keys_survive_as_text() {
        let secret = SecretKey::from_bytes(&[7; 32]);
        let read = SecretKey::parse(&format!("{}\n", secret.to_hex())).expect("a key");
        assert_eq!(PublicKey::parse(&read.public().to_string()), Ok(secret.public()));
        assert!(!format!("{secret:?}").contains(&secret.to_hex()));
        for wrong in ["", "12", &"x".repeat(64), &"+1".repeat(32)] {
            assert!(SecretKey::parse(wrong).is_err() && PublicKey::parse(wrong).is_err());
        }
    }
}
