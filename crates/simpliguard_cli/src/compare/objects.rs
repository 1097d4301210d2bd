//! The comparison of objects: each kind alone, framed on its own.

use simpliguard::{Error, Printable};
use simpliguard_eval::compare::{Options, compare};

use super::opened::Opened;
use super::rows::{ObjectOf, Row, Subject};
use crate::console;
use crate::error::UsageError;
use crate::inspect::document::triangles_of_node;
use crate::levels::{Kind, Level};

/// The kinds of objects of an output that are compared with those of its source.
pub(super) struct ObjectRows<'a> {
    source: &'a Opened,
    output: &'a Opened,
    kinds: Vec<&'a Kind>,
}

impl<'a> ObjectRows<'a> {
    /// Chooses at most so many kinds: those with the most triangles in the scene.
    ///
    /// # Errors
    /// If the source is not the one that the output was baked from.
    pub(super) fn choose(source: &'a Opened, output: &'a Opened, most: usize) -> Result<Self, UsageError> {
        let kinds: Vec<&Kind> = output.levels.kinds.iter().take(most).collect();
        let left_out = output.levels.kinds.len() - kinds.len();
        for kind in &kinds {
            if let Some(node) = kind.nodes.iter().find(|node| !is_same(source, output, **node)) {
                let (source, output, name) = (&source.file, &output.file, &kind.name);
                return Err(UsageError(format!(
                    "{output}: object '{name}' stands for node {node}, which does not show it in {source}; name the file \
                     that was baked, or leave objects out with --objects 0"
                )));
            }
        }
        if !kinds.is_empty() && left_out > 0 {
            let (file, compared) = (Printable(&output.file), kinds.len());
            console::line(&format!(
                "{file}: {left_out} kinds of objects with fewer triangles than those {compared} are left out; --objects N \
                 compares more"
            ));
        }
        Ok(Self { source, output, kinds })
    }

    /// Appends a row for each level of each kind.
    ///
    /// # Errors
    /// Those of the import.
    pub(super) fn compare(&self, options: &Options<'_>, rows: &mut Vec<Row>) -> Result<(), Error> {
        if !self.kinds.is_empty() {
            let (count, file) = (self.kinds.len(), Printable(&self.output.file));
            console::line(&format!("comparing {count} kinds of objects of {file} over {} views", options.views));
        }
        for kind in &self.kinds {
            self.compare_kind(kind, options, rows)?;
        }
        Ok(())
    }

    fn compare_kind(&self, kind: &Kind, options: &Options<'_>, rows: &mut Vec<Row>) -> Result<(), Error> {
        let Self { source, output, .. } = self;
        let alone = source.part(&kind.nodes, kind.drawn).import(&format!("{}, {}", source.file, kind.name))?;
        let level = |level: &Level| {
            let name = format!("{}, {}, {}", output.file, kind.name, level.name);
            output.part(&level.nodes, kind.drawn).import(&name)
        };
        let levels = kind.levels.iter().map(level).collect::<Result<Vec<_>, _>>()?;
        let compared = compare(&alone, &levels.iter().collect::<Vec<_>>(), options);
        let object = ObjectOf {
            object: kind.name.clone(),
            instances: kind.instances,
            source_faces: alone.surface.triangles.len(),
        };
        rows.extend(kind.levels.iter().zip(compared).map(|(level, comparison)| {
            let (name, object) = (Some(level.name.clone()), Some(object.clone()));
            let subject = Subject { file: output.file.clone(), name, level: Some(level.level), object };
            Row { subject, comparison }
        }));
        Ok(())
    }
}

/// Tells whether a node of the source has as many triangles as in the output, which may have dropped them.
fn is_same(source: &Opened, output: &Opened, node: usize) -> bool {
    let triangles = |opened: &Opened| triangles_of_node(&opened.model.document.json, node);
    let (baked, found) = (triangles(source), triangles(output));
    baked > 0 && (found == baked || found == 0)
}
