//! Where settings are written, and what a model gets in the end.
//!
//! ```sh
//! cargo run --example settings              # every model of assets/
//! cargo run --example settings -- mobile    # with the profile `mobile`
//! ```
//!
//! Later places win:
//!
//! 1. `defaults` of `config/simpliguard.ron`: for every model.
//! 2. `rules` there, each for a pattern of paths below `assets/`: `(glob: "props/**", settings: (faces: [250, 500]))`.
//! 3. The profile, a name for one kind of device: `"mobile": (texture_size: 512)`. A game chooses it when it starts:
//!    `SimpliguardPlugin { profile: Some("mobile".into()), ..default() }`.
//! 4. The file beside the model, `octopus.glb.meta`: for one model, in the format of Bevy's asset processor.
//!
//! All take the same fields; `docs/settings.md` lists them. Nothing has to be restarted for a change: while a game runs (try
//! `cargo run`), saving one of these files bakes the models that it changes and shows them. A mistake is reported with line,
//! column and the name that was probably meant, and the model keeps its last levels.

use std::path::Path;
use std::{env, fs};

use simpliguard::settings::{Layer, Origin, ProjectFile, parse_meta, resolve};

#[expect(clippy::print_stdout, reason = "the program's result")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    env::set_current_dir(env!("CARGO_MANIFEST_DIR"))?;
    let profile = env::args().nth(1);
    let project = ProjectFile::parse(&fs::read_to_string(ProjectFile::PATH)?, ProjectFile::PATH)?;
    let files = fs::read_dir("assets")?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let mut models: Vec<String> = files.collect::<Result<_, std::io::Error>>()?;
    models.retain(|file| file.ends_with(".glb") || file.ends_with(".gltf"));
    models.sort();
    for model in models {
        // What the plugin does when it imports the model.
        let mut layers = project.layers(&model, profile.as_deref())?;
        let meta = format!("{model}.meta");
        if let Ok(text) = fs::read_to_string(Path::new("assets").join(&meta))
            && let Some(overrides) = parse_meta(&text, &meta)?
        {
            layers.push(Layer { origin: Origin::Meta { file: meta }, overrides });
        }
        println!("{model}");
        let resolved = resolve(layers)?;
        for field in resolved.effective().filter(|field| !matches!(field.origin, Origin::BuiltIn | Origin::Preset(_))) {
            println!("    {:<28} // {}", format!("{}: {},", field.name, field.value), field.origin);
        }
    }
    Ok(())
}
