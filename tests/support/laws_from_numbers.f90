!> Laws from numbers, for tests, in one call each. Where they act is set apart.
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
   implicit none
   private
   public :: new_bouc_wen, new_coulomb_rigid, new_coulomb_tanh, new_cubic_damping, new_cubic_spring, new_elastic_stop
   public :: new_iwan, new_jenkins, new_jenkins_2d, new_polynomial, new_quadratic_damping, new_rigid_wall, new_van_der_pol

contains

   !> Of stiffness 1 and yield displacement 1.
   subroutine new_bouc_wen(law, exponent, beta)
      class(bouc_wen_t), intent(inout) :: law
      real(wp), intent(in) :: exponent, beta

      law%stiffness = 1.0_wp
      law%yield_displacement = 1.0_wp
      law%exponent = exponent
      law%beta = beta
      call law%derive()
   end subroutine new_bouc_wen

   subroutine new_coulomb_rigid(law, limit, augmentation)
      class(coulomb_rigid_t), intent(inout) :: law
      real(wp), intent(in) :: limit, augmentation

      law%limit = limit
      law%augmentation = augmentation
      call law%derive()
   end subroutine new_coulomb_rigid

   subroutine new_coulomb_tanh(law, limit, velocity)
      class(coulomb_tanh_t), intent(inout) :: law
      real(wp), intent(in) :: limit, velocity

      law%limit = limit
      law%velocity = velocity
      call law%derive()
   end subroutine new_coulomb_tanh

   subroutine new_cubic_damping(law, coefficient, speed)
      class(cubic_damping_t), intent(inout) :: law
      real(wp), intent(in) :: coefficient, speed

      law%coefficient = coefficient
      law%speed = speed
      call law%derive()
   end subroutine new_cubic_damping

   subroutine new_cubic_spring(law, stiffness)
      class(cubic_spring_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness

      law%stiffness = stiffness
      call law%derive()
   end subroutine new_cubic_spring

   subroutine new_elastic_stop(law, stiffness, gap, two_sided)
      class(elastic_stop_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, gap
      logical, intent(in) :: two_sided

      law%stiffness = stiffness
      law%gap = gap
      law%two_sided = two_sided
      call law%derive()
   end subroutine new_elastic_stop

   subroutine new_iwan(law, stiffness, limit)
      class(iwan_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness(:), limit(:)

      law%stiffness = stiffness
      law%limit = limit
      call law%derive()
   end subroutine new_iwan

   subroutine new_jenkins(law, stiffness, limit)
      class(jenkins_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, limit

      law%stiffness = stiffness
      law%limit = limit
      call law%derive()
   end subroutine new_jenkins

   subroutine new_jenkins_2d(law, stiffness, limit)
      class(jenkins_2d_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness, limit

      law%stiffness = stiffness
      law%limit = limit
      call law%derive()
   end subroutine new_jenkins_2d

   subroutine new_polynomial(law, stiffness, damping)
      class(polynomial_t), intent(inout) :: law
      real(wp), intent(in) :: stiffness(:), damping(:)

      law%stiffness = stiffness
      law%damping = damping
      call law%derive()
   end subroutine new_polynomial

   subroutine new_quadratic_damping(law, coefficient)
      class(quadratic_damping_t), intent(inout) :: law
      real(wp), intent(in) :: coefficient

      law%coefficient = coefficient
      call law%derive()
   end subroutine new_quadratic_damping

   subroutine new_rigid_wall(law, gap, augmentation, two_sided)
      class(rigid_wall_t), intent(inout) :: law
      real(wp), intent(in) :: gap, augmentation
      logical, intent(in) :: two_sided

      law%gap = gap
      law%augmentation = augmentation
      law%two_sided = two_sided
      call law%derive()
   end subroutine new_rigid_wall

   subroutine new_van_der_pol(law, strength, threshold)
      class(van_der_pol_t), intent(inout) :: law
      real(wp), intent(in) :: strength, threshold

      law%strength = strength
      law%threshold = threshold
      call law%derive()
   end subroutine new_van_der_pol
end module laws_from_numbers
