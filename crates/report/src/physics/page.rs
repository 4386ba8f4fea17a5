//! The page of the physics study: claims, figures and provenance in one HTML file that loads no other file.

use anyhow::Result;
use maud::{Markup, html};

use super::data::{Claim, Data};
use crate::figure::Figures;
use crate::page::{Section, document, figure_content, left_out_entry};
use crate::style::three_digits;

/// The whole page.
///
/// # Errors
/// When a picture cannot be painted.
pub(crate) fn html(data: &Data, figures: &Figures) -> Result<String> {
    let title = "Whisker contact localisation: physics";
    let holding = data.claims.iter().filter(|claim| claim.holds).count();
    let lead = html! {
        p {
            "Verification of the simulator against the quasi-static elastica and the analytic beam: "
            (holding) " of " (data.claims.len()) " claims hold."
        }
    };
    let mut sections = vec![Section { id: "claims", title: "Claims", content: claims_table(&data.claims) }];
    for figure in &figures.drawn {
        sections.push(Section { id: figure.name, title: figure.title, content: figure_content(figure)? });
    }
    Ok(document(title, lead, &sections, provenance(data, &figures.left_out)))
}

fn claims_table(claims: &[Claim]) -> Markup {
    html! {
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

fn sign_of(relation: &str) -> &str {
    match relation {
        "<=" => "≤",
        ">=" => "≥",
        other => other,
    }
}

fn provenance(data: &Data, left_out: &[&str]) -> Markup {
    let mark = &data.watermark;
    html! {
        footer #provenance {
            h2 { "Provenance" }
            dl {
                dt { "simulated by" } dd { (mark.generator.name) " " (mark.generator.version) ", MuJoCo " (mark.generator.mujoco) }
                dt { "compared with" } dd { "NumPy " (mark.numpy) ", SciPy " (mark.scipy) }
                dt { "commit" } dd { code { (mark.generator.git_commit.as_deref().unwrap_or("unknown")) } }
                dt { "source, SHA-256" } dd { code { (mark.generator.source_sha256) } }
                (left_out_entry(left_out))
            }
        }
    }
}
