//! Text tables.

/// Cell of a quantity that is not known.
pub(super) const UNKNOWN: &str = "-";

/// Renders a table with aligned columns: the first `left` columns flush left, the others flush right.
pub(super) fn render(header: &[&str], rows: &[Vec<String>], left: usize) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([header[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let cells: Vec<String> = cells
            .zip(&widths)
            .enumerate()
            .map(|(i, (cell, &width))| if i < left { format!("{cell:<width$}") } else { format!("{cell:>width$}") })
            .collect();
        format!("{}\n", cells.join("  ").trim_end())
    };
    let mut text = line(&mut header.iter().copied());
    text.push_str(&line(
        &mut widths.iter().map(|&width| "-".repeat(width)).collect::<Vec<_>>().iter().map(String::as_str),
    ));
    for row in rows {
        text.push_str(&line(&mut row.iter().map(String::as_str)));
    }
    text
}

/// A length (m) in millimetres with three decimals; a dash for `None`.
pub(super) fn millimetres(length_m: Option<f64>) -> String {
    length_m.map_or(UNKNOWN.into(), |length| format!("{:.3}", length * 1e3))
}

/// A number with two decimals, in scientific notation from 1e5 on; a dash for `None`.
pub(super) fn number(value: Option<f64>) -> String {
    const HUGE: f64 = 1e5;
    value
        .map_or(UNKNOWN.into(), |value| if value.abs() < HUGE { format!("{value:.2}") } else { format!("{value:.1e}") })
}

/// A share in per cent; a dash for `None`.
pub(super) fn percent(share: Option<f64>) -> String {
    share.map_or(UNKNOWN.into(), |share| format!("{:.0} %", 100.0 * share))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_huge_numbers_stay_short() {
        let printed = [None, Some(0.0), Some(-12.346), Some(3.187e9), Some(f64::INFINITY)].map(number);
        assert_eq!(printed, ["-", "0.00", "-12.35", "3.2e9", "inf"]);
    }
}
