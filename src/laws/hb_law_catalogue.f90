!> The laws by their names, one case each: the types of `&law` in the table of input keys.
module hb_law_catalogue
   use hb_law, only: law_box_t
   use hb_law_annular_clearance, only: annular_clearance_t
   use hb_law_blade_contact, only: blade_contact_t
   use hb_law_bouc_wen, only: bouc_wen_t
   use hb_law_contact_table, only: contact_table_t
   use hb_law_coulomb_rigid, only: coulomb_rigid_t
   use hb_law_coulomb_tanh, only: coulomb_tanh_t
   use hb_law_cubic_damping, only: cubic_damping_t
   use hb_law_cubic_spring, only: cubic_spring_t
   use hb_law_elastic_stop, only: elastic_stop_t
   use hb_law_electrostatic, only: electrostatic_t
   use hb_law_hertz, only: hertz_t
   use hb_law_iwan, only: iwan_t
   use hb_law_jenkins, only: jenkins_t
   use hb_law_jenkins_2d, only: jenkins_2d_t
   use hb_law_parametric, only: parametric_t
   use hb_law_piecewise_linear, only: piecewise_linear_t
   use hb_law_polynomial, only: polynomial_t
   use hb_law_polynomial_coupled, only: polynomial_coupled_t
   use hb_law_quadratic_damping, only: quadratic_damping_t
   use hb_law_rigid_wall, only: rigid_wall_t
   use hb_law_rolling_bearing, only: rolling_bearing_t
   use hb_law_short_bearing, only: short_bearing_t
   use hb_law_stribeck, only: stribeck_t
   use hb_law_tabulated, only: tabulated_t
   use hb_law_user, only: user_law_t
   use hb_law_van_der_pol, only: van_der_pol_t
   implicit none
   private
   public :: allocate_law

contains

   !> Allocates a law of the named kind with its defaults; the box remains empty if there is no such kind.
   subroutine allocate_law(box, name)
      type(law_box_t), intent(out) :: box
      character(*), intent(in) :: name                                !! a type of `&law` in the table of keys

      select case (name)
      case ("annular_clearance"); allocate (annular_clearance_t :: box%law)
      case ("blade_contact"); allocate (blade_contact_t :: box%law)
      case ("bouc_wen"); allocate (bouc_wen_t :: box%law)
      case ("contact_table"); allocate (contact_table_t :: box%law)
      case ("coulomb_rigid"); allocate (coulomb_rigid_t :: box%law)
      case ("coulomb_tanh"); allocate (coulomb_tanh_t :: box%law)
      case ("cubic_damping"); allocate (cubic_damping_t :: box%law)
      case ("cubic_spring"); allocate (cubic_spring_t :: box%law)
      case ("elastic_stop"); allocate (elastic_stop_t :: box%law)
      case ("electrostatic"); allocate (electrostatic_t :: box%law)
      case ("hertz"); allocate (hertz_t :: box%law)
      case ("iwan"); allocate (iwan_t :: box%law)
      case ("jenkins"); allocate (jenkins_t :: box%law)
      case ("jenkins_2d"); allocate (jenkins_2d_t :: box%law)
      case ("parametric"); allocate (parametric_t :: box%law)
      case ("piecewise_linear"); allocate (piecewise_linear_t :: box%law)
      case ("polynomial"); allocate (polynomial_t :: box%law)
      case ("polynomial_coupled"); allocate (polynomial_coupled_t :: box%law)
      case ("quadratic_damping"); allocate (quadratic_damping_t :: box%law)
      case ("rigid_wall"); allocate (rigid_wall_t :: box%law)
      case ("rolling_bearing"); allocate (rolling_bearing_t :: box%law)
      case ("short_bearing"); allocate (short_bearing_t :: box%law)
      case ("stribeck"); allocate (stribeck_t :: box%law)
      case ("tabulated"); allocate (tabulated_t :: box%law)
      case ("user"); allocate (user_law_t :: box%law)
      case ("van_der_pol"); allocate (van_der_pol_t :: box%law)
      end select
   end subroutine allocate_law
end module hb_law_catalogue
