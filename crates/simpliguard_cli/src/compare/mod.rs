//! `simpliguard compare`: how much levels look like their source, and how far they are from it.

mod objects;
mod opened;
mod rows;

use std::borrow::Cow;

use simpliguard::data::Model;
use simpliguard::{Error, Printable};
use simpliguard_eval::Lpips;
use simpliguard_eval::compare::{Options, compare};

use self::objects::ObjectRows;
use self::opened::Opened;
use self::rows::{Document, Row, Subject, table};
use crate::args::CompareArgs;
use crate::console;
use crate::error::UsageError;
use crate::output::{json_text, write_stdout};

pub(crate) fn run(args: &CompareArgs) -> Result<(), UsageError> {
    let lpips = args.lpips_weights.as_deref().map(Lpips::open).transpose()?;
    let (views, lpips) = (args.views.get().into(), lpips.as_ref());
    let options = Options { views, motion: args.motion, lpips, ..Options::default() };
    let source = Opened::read(&args.source)?;
    let given = args.levels.iter().map(|path| Opened::read(path)).collect::<Result<Vec<_>, _>>()?;
    let outputs: Vec<&Opened> = if given.is_empty() { vec![&source] } else { given.iter().collect() };
    if given.is_empty() && source.levels.all.is_empty() {
        let source = &source.file;
        return Err(UsageError(format!("{source}: it holds no levels to compare; name the files of its levels")));
    }
    let objects = outputs.iter().map(|output| ObjectRows::choose(&source, output, args.objects));
    let objects = objects.collect::<Result<Vec<_>, _>>()?;
    let (mut rows, faces) = whole_pictures(&source, &outputs, &options)?;
    for objects in &objects {
        objects.compare(&options, &mut rows)?;
    }
    let text = if args.json {
        json_text(&Document::new(&source.file, faces, options.views, &rows))?
    } else {
        table(&rows, &options)
    };
    write_stdout(&text)
}

/// Compares whole files, and levels of whole files, with the source. Returns the rows, and the triangles of the source.
fn whole_pictures(source: &Opened, outputs: &[&Opened], options: &Options<'_>) -> Result<(Vec<Row>, usize), Error> {
    let mut candidates = Vec::new();
    for output in outputs {
        candidates.extend(output.candidates()?);
    }
    let (count, views) = (candidates.len(), options.views);
    console::line(&format!("comparing {count} levels with {} over {views} views", Printable(&source.file)));
    let (subjects, models): (Vec<Subject>, Vec<Cow<'_, Model>>) = candidates.into_iter().unzip();
    let models: Vec<&Model> = models.iter().map(Cow::as_ref).collect();
    let shown = source.levels.source_of(&source.model)?;
    let compared = compare(&shown, &models, options);
    let row = |(subject, comparison)| Row { subject, comparison };
    Ok((subjects.into_iter().zip(compared).map(row).collect(), shown.surface.triangles.len()))
}
