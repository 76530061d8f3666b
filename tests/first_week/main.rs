//! The jobs of a first week, as a user does them: with the program alone, in a folder outside of the checkout, from what the
//! documentation says.
//!
//! `SWM_FIRST_WEEK_COMMAND` names an installed program; without it, the one that is built next to the tests.

mod evaluate;
mod home;
mod mistakes;
mod own;
mod record;
