//! Text of the page: names that are safe in HTML, and numbers that are easy to read.

use simpliguard::Printable;

/// A text from a file or the command line, for the content of an element or a quoted attribute. Characters that steer the
/// direction of writing or a terminal are shown as escapes.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in Printable(text).to_string().chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// JSON for a script element, which ends at the first `</script`, and changes its meaning at `<!--`.
pub(super) fn json_in_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// A whole number with a comma at each thousand.
pub(super) fn count(value: f64) -> String {
    let digits = format!("{:.0}", value.max(0.0));
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// A number of models.
pub(super) fn models(number: usize) -> String {
    if number == 1 { "1 model".to_owned() } else { format!("{} models", count(number as f64)) }
}

/// A number of bytes in the largest unit that leaves a number above one.
pub(super) fn bytes(value: f64) -> String {
    const UNITS: [&str; 4] = ["B", "kB", "MB", "GB"];
    let (mut value, mut unit) = (value.max(0.0), 0);
    while value >= 1000.0 && unit + 1 < UNITS.len() {
        (value, unit) = (value / 1000.0, unit + 1);
    }
    let decimals = usize::from(unit > 1 && value < 100.0);
    format!("{value:.decimals$} {}", UNITS[unit])
}

/// A number with two decimals, as of decibels and of seconds.
pub(super) fn two(value: f64) -> String {
    format!("{value:.2}")
}

/// A number with three decimals.
pub(super) fn three(value: f64) -> String {
    format!("{value:.3}")
}

/// A fraction in percent.
pub(super) fn percent(fraction: f64) -> String {
    format!("{:.2}", 100.0 * fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_become_markup() {
        let name = "</script><img src=x onerror='a(\"b\")'>&\u{202e}.glb";
        let found = escaped(name);
        assert!(!found.contains(['<', '>', '"', '\'', '\u{202e}']), "{found}");
        assert!(
            found.starts_with("&lt;/script&gt;&lt;img src=x onerror=&#39;a(&quot;b&quot;)&#39;&gt;&amp;"),
            "{found}"
        );
    }

    #[test]
    fn json_cannot_end_its_script() {
        let json = serde_json::to_string(&["</script><!--", "a<b"]).expect("serialises");
        let found = json_in_script(&json);
        assert!(!found.contains('<'), "{found}");
        assert_eq!(serde_json::from_str::<Vec<String>>(&found).expect("JSON"), ["</script><!--", "a<b"]);
    }

    #[test]
    fn numbers_are_grouped_and_have_their_units() {
        assert_eq!([0.0, 999.0, 1000.0, 1_234_567.4].map(count), ["0", "999", "1,000", "1,234,567"]);
        let sizes = [12.0, 1500.0, 5_592_405.0, 123_456_789.0, 2e10];
        assert_eq!(sizes.map(bytes), ["12 B", "2 kB", "5.6 MB", "123 MB", "20.0 GB"]);
        assert_eq!((two(31.456), three(0.0425), percent(0.98765)), ("31.46".into(), "0.043".into(), "98.77".into()));
    }
}
