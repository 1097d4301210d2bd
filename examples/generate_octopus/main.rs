//! Generates `assets/octopus.glb`: a rigged, textured and animated model to try the baker on.
//!
//! ```text
//! cargo run --example generate_octopus
//! ```
//!
//! Everything is a swept surface over `(along, around)` in `[0, 1]^2`: one for the body, one per arm, one per eye
//! ([`shape`]). That parametrisation is also the texture atlas ([`skin`]) and the axis along which cubic B-splines spread
//! the joints' influence, four joints per vertex ([`rig`]). The output is core glTF 2.0 without extensions ([`glb`]).
//!
//! Transcendental functions come from `libm` and nothing depends on time or threads, so the file is equal on every machine.

mod glb;
mod rig;
mod shape;
mod skin;

use shape::Octopus;

fn generate() -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let octopus = Octopus::new();
    let mesh = octopus.mesh();
    let texture = skin::paint(&octopus)?;
    let rig = rig::Rig::new(&octopus);
    Ok(glb::write(&mesh, &rig.bind(&mesh), &rig, &texture)?)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/octopus.glb");
    std::fs::write(path, generate()?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn committed_model_is_what_the_generator_writes() {
        let committed = include_bytes!("../../assets/octopus.glb");
        let generated = super::generate().expect("the generator has no input that could be wrong");
        assert!(committed[..] == generated[..], "run `cargo run --example generate_octopus` and commit the result");
    }
}
