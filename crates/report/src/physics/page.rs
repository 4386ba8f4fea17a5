//! The page of the physics study: claims, figures and the watermark in one HTML file that fetches nothing.

use anyhow::Result;
use maud::{DOCTYPE, Markup, html};

use super::data::{Claim, Data};
use crate::figure::Drawn;
use crate::page::{figure_section, head};
use crate::style::three_digits;

/// The whole page.
///
/// # Errors
/// When a picture cannot be painted.
pub(crate) fn html(data: &Data, drawn: &[Drawn]) -> Result<String> {
    let title = "Whisker contact localisation: physics";
    let holding = data.claims.iter().filter(|claim| claim.holds).count();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            (head(title))
            body {
                header {
                    h1 { (title) }
                    p {
                        "The simulator against the exact quasi-static whisker and against the analytic beam: "
                        (holding) " of " (data.claims.len()) " claims hold."
                    }
                    nav {
                        @for figure in drawn { a href={ "#" (figure.name) } { (figure.title) } }
                        a href="#claims" { "Claims" }
                        a href="#provenance" { "Provenance" }
                    }
                }
                main {
                    @for figure in drawn { (figure_section(figure)?) }
                    (claims_table(&data.claims))
                }
                (provenance(data))
            }
        }
    };
    Ok(page.into_string())
}

fn claims_table(claims: &[Claim]) -> Markup {
    html! {
        section #claims {
            h2 { "Claims" }
            p { "As data: " a href="claims.csv" { "claims.csv" } }
            div.scroll tabindex="0" aria-label="Table: claims" {
                table {
                    thead { tr { th { "claim" } th.number { "measured" } th.number { "bound" } th { "unit" } th {} } }
                    tbody {
                        @for claim in claims {
                            tr {
                                td { (claim.claim) }
                                td.number { (three_digits(claim.measured)) }
                                td.number { (sign_of(&claim.relation)) " " (claim.bound) }
                                td { (claim.unit) }
                                td { @if claim.holds { "holds" } @else { b { "does not hold" } } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn sign_of(relation: &str) -> &str {
    match relation {
        "<=" => "≤",
        ">=" => "≥",
        other => other,
    }
}

fn provenance(data: &Data) -> Markup {
    let mark = &data.watermark;
    html! {
        footer #provenance {
            h2 { "Provenance" }
            dl {
                dt { "simulated by" } dd { (mark.generator.name) " " (mark.generator.version) ", MuJoCo " (mark.generator.mujoco) }
                dt { "compared with" } dd { "NumPy " (mark.numpy) ", SciPy " (mark.scipy) }
                dt { "commit" } dd { code { (mark.generator.git_commit.as_deref().unwrap_or("unknown")) } }
                dt { "source, SHA-256" } dd { code { (mark.generator.source_sha256) } }
            }
        }
    }
}
