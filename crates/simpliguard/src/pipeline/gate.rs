//! What happens to levels that miss their bars.

use super::bars::GateParams;
use super::level_maker::{LevelMaker, Made};
use crate::Error;
use crate::settings::OnMiss;

/// Most faces that a raised budget may have, as a multiple of the one that was asked for.
const MOST_RAISED: u32 = 4;

/// Refuses levels that miss a bar, if that is asked for.
pub(super) fn check(gate: &GateParams, asset: &str, made: &Made) -> Result<(), Error> {
    if gate.on_miss != OnMiss::Fail {
        return Ok(());
    }
    let missed = made.reports.iter().find_map(|report| Some((report.level, gate.missed(report)?)));
    match missed {
        Some((level, found)) => Err(Error::Gate { asset: asset.to_owned(), level, found }),
        None => Ok(()),
    }
}

/// Makes levels that miss a bar again with half as many more faces until they meet it, if that is asked for: the most
/// detailed level first, because each stays below the next. A level has at most four times its budget.
pub(super) fn raise(gate: &GateParams, maker: &mut LevelMaker<'_>, made: &mut Made) -> Result<(), Error> {
    if gate.on_miss != OnMiss::RaiseBudget {
        return Ok(());
    }
    let mut above = maker.source_faces() as u32;
    for i in (0..made.reports.len()).rev() {
        let asked = made.reports[i].budget;
        let most = asked.saturating_mul(MOST_RAISED).min(above.saturating_sub(1));
        let mut budget = asked;
        while budget < most && gate.missed(&made.reports[i]).is_some() {
            budget = (budget + budget.div_ceil(2)).min(most);
            (made.levels[i], made.reports[i]) = maker.make_again(i, budget)?;
        }
        if budget > asked {
            let outcome =
                if gate.missed(&made.reports[i]).is_some() { "and misses them still" } else { "to meet them" };
            made.notes.push(format!("LOD{} missed its bars at {asked} faces: it has {budget} now, {outcome}", i + 1));
        }
        above = made.reports[i].faces;
    }
    Ok(())
}
