!> Laws from numbers, for tests: as a caller of the library makes them, by properties. Where they act is set apart.
module laws_from_numbers
   use hb_kinds, only: wp
   use hb_law_bouc_wen, only: bouc_wen_t
   use hb_law_coulomb_rigid, only: coulomb_rigid_t
   use hb_law_coulomb_tanh, only: coulomb_tanh_t
   use hb_law_cubic_damping, only: cubic_damping_t
   use hb_law_cubic_spring, only: cubic_spring_t
   use hb_law_elastic_stop, only: elastic_stop_t
   use hb_law_iwan, only: iwan_t
   use hb_law_jenkins, only: jenkins_t
   use hb_law_jenkins_2d, only: jenkins_2d_t
   use hb_law_polynomial, only: polynomial_t
   use hb_law_quadratic_damping, only: quadratic_damping_t
   use hb_law_rigid_wall, only: rigid_wall_t
   use hb_law_van_der_pol, only: van_der_pol_t
   use hb_properties, only: new_properties, properties_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: new_bouc_wen, new_coulomb_rigid, new_coulomb_tanh, new_cubic_damping, new_cubic_spring, new_elastic_stop
   public :: new_iwan, new_jenkins, new_jenkins_2d, new_polynomial, new_quadratic_damping, new_rigid_wall, new_van_der_pol

contains

   !> Of stiffness 1 and yield displacement 1.
   subroutine new_bouc_wen(law, exponent, beta)
      class(bouc_wen_t), intent(inout) :: law
      real(wp), intent(in) :: exponent, beta
      type(properties_t) :: group

      call begin(group, "bouc_wen")
      call group%set("stiffness", 1.0_wp)
      call group%set("yield_displacement", 1.0_wp)
      call group%set("exponent", exponent)
      call group%set("beta", beta)
      call law%read(group, nowhere())
   end subroutine new_bouc_wen

   subroutine new_coulomb_rigid(law, limit, augmentation)
      class(coulomb_rigid_t), intent(inout) :: law
      real(wp), intent(in) :: limit, augmentation
      type(properties_t) :: group

      call begin(group, "coulomb_rigid")
      call group%set("limit", limit)
      call group%set("augmentation", augmentation)
      call law%read(group, nowhere())
   end subroutine new_coulomb_rigid

   subroutine new_coulomb_tanh(law, limit, velocity)
      class(coulomb_tanh_t), intent(inout) :: law
      real(wp), intent(in) :: limit, velocity
      type(properties_t) :: group

      call begin(group, "coulomb_tanh")
      call group%set("limit", limit)
      call group%set("velocity", velocity)
      call law%read(group, nowhere())
   end subroutine new_coulomb_tanh

   subroutine new_cubic_damping(law, coefficient, speed)
      class(cubic_damping_t), intent(inout) :: law
      real(wp), intent(in) :: coefficient, speed
      type(properties_t) :: group

      call begin(group, "cubic_damping")
      call group%set("coefficient", coefficient)
      call group%set("speed", speed)
      call law%read(group, nowhere())
   end subroutine new_cubic_damping

   subroutine new_cubic_spring(law, stiffness)
      class(cubic_spring_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness
      type(properties_t) :: group

      call begin(group, "cubic_spring")
      call group%set("stiffness", stiffness)
      call law%read(group, nowhere())
   end subroutine new_cubic_spring

   subroutine new_elastic_stop(law, stiffness, gap, two_sided)
      class(elastic_stop_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, gap
      logical, intent(in) :: two_sided
      type(properties_t) :: group

      call begin(group, "elastic_stop")
      call group%set("stiffness", stiffness)
      call group%set("gap", gap)
      call group%set("two_sided", two_sided)
      call law%read(group, nowhere())
   end subroutine new_elastic_stop

   subroutine new_iwan(law, stiffness, limit)
      class(iwan_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness(:), limit(:)
      type(properties_t) :: group

      call begin(group, "iwan")
      call group%set("stiffness", stiffness)
      call group%set("limit", limit)
      call law%read(group, nowhere())
   end subroutine new_iwan

   subroutine new_jenkins(law, stiffness, limit)
      class(jenkins_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, limit
      type(properties_t) :: group

      call begin(group, "jenkins")
      call group%set("stiffness", stiffness)
      call group%set("limit", limit)
      call law%read(group, nowhere())
   end subroutine new_jenkins

   subroutine new_jenkins_2d(law, stiffness, limit)
      class(jenkins_2d_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, limit
      type(properties_t) :: group

      call begin(group, "jenkins_2d")
      call group%set("stiffness", stiffness)
      call group%set("limit", limit)
      call law%read(group, nowhere())
   end subroutine new_jenkins_2d

   subroutine new_polynomial(law, stiffness, damping)
      class(polynomial_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness(:), damping(:)
      type(properties_t) :: group

      call begin(group, "polynomial")
      call group%set("stiffness", stiffness)
      call group%set("damping", damping)
      if (allocated(law%stiffness)) deallocate (law%stiffness)
      if (allocated(law%damping)) deallocate (law%damping)
      call law%read(group, nowhere())
   end subroutine new_polynomial

   subroutine new_quadratic_damping(law, coefficient)
      class(quadratic_damping_t), intent(inout) :: law
      real(wp), intent(in) :: coefficient
      type(properties_t) :: group

      call begin(group, "quadratic_damping")
      call group%set("coefficient", coefficient)
      call law%read(group, nowhere())
   end subroutine new_quadratic_damping

   subroutine new_rigid_wall(law, gap, augmentation, two_sided)
      class(rigid_wall_t), intent(inout) :: law
      real(wp), intent(in) :: gap, augmentation
      logical, intent(in) :: two_sided
      type(properties_t) :: group

      call begin(group, "rigid_wall")
      call group%set("gap", gap)
      call group%set("augmentation", augmentation)
      call group%set("two_sided", two_sided)
      call law%read(group, nowhere())
   end subroutine new_rigid_wall

   subroutine new_van_der_pol(law, strength, threshold)
      class(van_der_pol_t), intent(inout) :: law
      real(wp), intent(in) :: strength, threshold
      type(properties_t) :: group

      call begin(group, "van_der_pol")
      call group%set("strength", strength)
      call group%set("threshold", threshold)
      call law%read(group, nowhere())
   end subroutine new_van_der_pol

   subroutine begin(group, type)
      type(properties_t), intent(out) :: group
      character(*), intent(in) :: type

      call new_properties(group, "law", "", 0)
      call group%set("type", type)
   end subroutine begin

   !> A structure without degrees of freedom: the law gets no place.
   function nowhere() result(structure)
      type(structure_t) :: structure
   end function nowhere
end module laws_from_numbers
