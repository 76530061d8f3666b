//! The rules that every environment keeps.

#[test]
fn it_conforms() {
    swm_core::testing::assert_conforms(&{{crate_name}}::POINT);
}
