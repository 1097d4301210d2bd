//! Values of the field `object_rules`, and the settings of one object of a scene.

use globset::GlobMatcher;

use super::fields::{BakeOverrides, BakeSettings, ObjectRule};
use super::value::{Limit, Value};
use crate::data::compile_glob;

/// Most entries of the list.
const MOST: usize = 64;

impl ObjectRule {
    fn matcher(&self) -> Option<GlobMatcher> {
        compile_glob(&self.node, |_| {}).ok()
    }

    /// Tells whether all fields that are set concern an object, and not the scene around it.
    fn is_of_an_object(&self) -> bool {
        let BakeOverrides { scope, objects, object_rules, .. } = &self.settings;
        let BakeOverrides { whole, shared_atlas, source, existing_lods, texture_compression, .. } = &self.settings;
        let divides = scope.is_some() || objects.is_some() || object_rules.is_some();
        let is_of_levels = whole.is_some() || shared_atlas.is_some() || existing_lods.is_some();
        !divides && !is_of_levels && source.is_none() && texture_compression.is_none()
    }
}

impl Value for Vec<ObjectRule> {
    fn accepts(_: Limit) -> String {
        format!(
            "at most {MOST} of (node: \"glob\", settings: (..)), without scope, objects, object_rules, whole, \
             shared_atlas, source, existing_lods and texture_compression"
        )
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Ok(Self::new());
        }
        let expected = |error| format!("RON such as [(node: \"Rock*\", settings: (faces: [100]))] ({error})");
        ron::from_str(text).map_err(expected)
    }

    fn ron(&self) -> String {
        let settings = |rule: &ObjectRule| rule.settings.entries().iter().map(|(n, v)| format!("{n}: {v}")).collect();
        let item = |rule: &ObjectRule| {
            let settings: Vec<String> = settings(rule);
            format!("(node: {:?}, settings: ({}))", rule.node, settings.join(", "))
        };
        format!("[{}]", self.iter().map(item).collect::<Vec<_>>().join(", "))
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let is_valid = |rule: &ObjectRule| rule.matcher().is_some() && rule.is_of_an_object();
        if self.len() <= MOST && self.iter().all(is_valid) { Ok(()) } else { Err(Self::accepts(limit)) }
    }
}

/// The rules that match an object: a bit for each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MatchingRules(u64);

impl MatchingRules {
    pub(crate) fn bits(self) -> u64 {
        self.0
    }

    pub(crate) fn from_bits(bits: u64) -> Self {
        Self(bits)
    }
}

/// Finds the rules that match the name of an object.
pub(crate) struct RuleMatcher(Vec<Option<GlobMatcher>>);

impl RuleMatcher {
    pub(crate) fn of(settings: &BakeSettings) -> Self {
        Self(settings.object_rules.iter().map(ObjectRule::matcher).collect())
    }

    pub(crate) fn find(&self, name: &str) -> MatchingRules {
        let is_match = |glob: &Option<GlobMatcher>| glob.as_ref().is_some_and(|glob| glob.is_match(name));
        let bits = self.0.iter().enumerate().filter(|(_, glob)| is_match(glob)).map(|(i, _)| 1_u64 << i);
        MatchingRules(bits.sum())
    }
}

impl BakeSettings {
    /// The settings of an object to which some rules apply, later ones over earlier ones. A rule with another quality changes
    /// all values that are those of the scene's quality.
    pub(crate) fn with_object_rules(&self, matching: MatchingRules) -> Self {
        let mut settings = self.clone();
        let rules = self.object_rules.iter().enumerate().filter(|(i, _)| matching.0 >> i & 1 == 1);
        for (_, rule) in rules {
            if let Some(quality) = rule.settings.quality {
                settings = settings.at_quality(quality);
            }
            settings.apply(rule.settings.clone());
        }
        settings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Quality, parse_overrides};

    const RULES: &str = "(object_rules: [(node: \"Rock*\", settings: (faces: [300, 100], texture_size: 256)), \
                         (node: \"*Hero*\", settings: (quality: Best)), (node: \"RockHero\", settings: (faces: [900]))])";

    fn settings() -> BakeSettings {
        let mut settings = BakeSettings { gutter: 7, ..BakeSettings::default() };
        settings.apply(parse_overrides(RULES, "a.ron").expect("valid"));
        settings
    }

    #[test]
    fn rules_apply_in_their_order() {
        let settings = settings();
        let of = |name: &str| settings.with_object_rules(RuleMatcher::of(&settings).find(name));
        assert_eq!(of("House"), settings);
        let rock = of("Rock.001");
        assert_eq!((&rock.faces[..], rock.texture_size.clone(), rock.gutter), (&[100, 300][..], 256.into(), 7));
        let hero = of("AHero");
        let best = BakeSettings::preset(Quality::Best);
        assert_eq!((hero.quality, hero.views, hero.gutter), (Quality::Best, best.views, 7));
        assert_ne!(settings.views, best.views);
        let both = of("RockHero");
        assert_eq!((&both.faces[..], both.quality), (&[900][..], Quality::Best));
    }

    #[test]
    fn rules_survive_as_a_text() {
        let rules = settings().object_rules;
        assert_eq!(ron::from_str::<Vec<ObjectRule>>(&rules.ron()).expect("valid"), rules, "{}", rules.ron());
        assert_eq!(Vec::<ObjectRule>::from_arg(&rules.ron()), Ok(rules));
        assert_eq!(Vec::<ObjectRule>::from_arg(""), Ok(Vec::new()));
        assert!(Vec::<ObjectRule>::from_arg("Rock*").is_err());
    }

    #[test]
    fn rules_say_nothing_of_the_scene() {
        for settings in
            ["scope: Objects", "objects: [\"a\"]", "object_rules: []", "source: Drop", "existing_lods: Replace"]
        {
            let text = format!("(object_rules: [(node: \"a\", settings: ({settings}))])");
            let message = parse_overrides(&text, "a.ron").expect_err(settings).to_string();
            assert!(message.contains("object_rules") && message.contains("without scope"), "{message}");
        }
        assert!(parse_overrides("(object_rules: [(node: \"[\", settings: ())])", "a.ron").is_err());
        let message = parse_overrides("(object_rules: [(node: \"a\", settings: (fces: [1]))])", "a.ron");
        assert!(message.expect_err("a typo").to_string().contains("fces"));
    }
}
