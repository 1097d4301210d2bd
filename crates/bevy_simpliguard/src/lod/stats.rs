//! Statistics: the triangles and draw calls that the levels save, for an overlay or a log.

use bevy::prelude::*;

use super::components::LodGroup;
use super::switch::LodState;

/// Triangles that instances with levels draw, counted anew each frame at the end of `PostUpdate`.
///
/// A mesh counts once if any camera or shadow sees it. Models without levels do not count.
#[derive(Resource, Reflect, Clone, Debug, Default, PartialEq, Eq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct LodStats {
    /// Number of instances with levels.
    pub groups: u32,
    /// Number of these instances that a camera or shadow sees.
    pub visible_groups: u32,
    /// Triangles drawn.
    pub triangles: u64,
    /// Triangles of the sources of the visible instances. For a file without the source, those of its most detailed
    /// level.
    pub source_triangles: u64,
    /// Mesh entities drawn. The renderer may draw those of several instances in one call.
    pub draw_calls: u64,
    /// Mesh entities of the sources of the visible instances.
    pub source_draw_calls: u64,
    /// Statistics of each level. The index is the number of the level, 0 for the source.
    pub levels: Vec<LodLevelStats>,
}

/// Statistics of the levels with one number.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LodLevelStats {
    /// Number of instances that show it. During a cross-fade, an instance counts for both levels.
    pub groups: u32,
    /// Triangles drawn.
    pub triangles: u64,
}

/// Counts the triangles of a frame.
pub(super) fn count(
    mut stats: ResMut<'_, LodStats>,
    groups: Query<'_, '_, (&LodGroup, &LodState)>,
    visibility: Query<'_, '_, &ViewVisibility>,
) {
    let mut levels = std::mem::take(&mut stats.bypass_change_detection().levels);
    levels.fill(LodLevelStats::default());
    let mut sum = LodStats { levels, ..default() };
    let is_seen = |entity| visibility.get(entity).is_ok_and(|v| v.get());
    for (group, state) in &groups {
        sum.groups += 1;
        let Some(choice) = state.choice() else { continue };
        let mut is_visible = false;
        for slot in state.drawn() {
            let Some(level) = group.levels.get(slot) else { continue };
            let seen = level.primitives.iter().filter(|p| is_seen(p.entity));
            let (parts, triangles) = seen.fold((0, 0), |(n, sum): (u64, u64), p| (n + 1, sum + u64::from(p.faces)));
            if parts > 0 {
                is_visible = true;
                sum.add(level.level, triangles);
                sum.draw_calls += parts;
            }
        }
        if is_visible {
            sum.visible_groups += 1;
            // What stands for all objects has their sources, too, while they are hidden.
            let objects = group.objects.iter().filter(|_| choice.main() > 0);
            let others = objects.filter_map(|object| groups.get(*object).ok()).map(|(object, _)| object);
            for source in others.chain([group]).filter_map(|group| group.levels.first()) {
                sum.source_triangles += u64::from(source.faces);
                sum.source_draw_calls += source.primitives.len() as u64;
            }
        }
    }
    *stats = sum;
}

impl LodStats {
    fn add(&mut self, level: u32, triangles: u64) {
        let level = level as usize;
        if self.levels.len() <= level {
            self.levels.resize(level + 1, LodLevelStats::default());
        }
        self.levels[level].groups += 1;
        self.levels[level].triangles += triangles;
        self.triangles += triangles;
    }
}
