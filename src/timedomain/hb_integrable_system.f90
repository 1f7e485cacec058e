!> What decides by which methods a system can be integrated in time, and in which steps: its mass, its laws, its fastest mode.
module hb_integrable_system
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_integration_config, only: integration_method
   use hb_integration_system, only: has_sparse_steps
   use hb_kinds, only: wp
   use hb_modes, only: fastest_frequency
   use hb_structure, only: max_dense, max_dofs, max_sparse_dofs, structure_t
   use hb_sundials, only: has_cvode
   use hb_system, only: system_t
   implicit none
   private
   public :: fastest_of, fixed_step_method_of, has_bounds_of, is_stiff, lacks_mass, largest_integrable

contains

   !> Whether the mass is singular: implicit steps alone can then integrate the equations, see hb_generalized_alpha.
   logical function lacks_mass(system)
      type(system_t), intent(in) :: system
      type(structure_t) :: structure
      real(wp), allocatable :: factor(:, :)
      integer :: singular_at

      lacks_mass = .false.
      if (system%structure%n_dofs > max_dense) return                 ! refused before any step
      structure = system%structure
      call structure%unpack()
      call structure%factorise_mass(factor, singular_at)
      lacks_mass = singular_at /= 0
   end function lacks_mass

   !> Whether some coordinate is so much faster than what is integrated that explicit steps would not end: an undamped one by the
   !> square root of k/m, a damped one by c/m, of the diagonals. Implicit steps pass over its own vibration.
   logical function is_stiff(system, period, highest)
      type(system_t), intent(in) :: system
      real(wp), intent(in) :: period                                  !! [s] of the slowest tone
      real(wp), intent(in) :: highest                                 !! frequency of interest [rad/s]
      real(wp), parameter :: max_radians = 1.0e6_wp                   ! of the fastest one in the period: a few million steps
      real(wp), parameter :: min_distance = 1.0e3_wp                  ! from the highest frequency of interest
      type(structure_t) :: structure
      real(wp) :: rate
      integer :: i

      is_stiff = .false.
      if (system%structure%n_dofs > max_dofs .or. any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])) return
      structure = system%structure
      call structure%unpack()
      rate = 0.0_wp
      do i = 1, structure%n_dofs
         associate (m => structure%mass(i, i))
            if (.not. m > 0.0_wp) cycle
            rate = max(rate, sqrt(abs(structure%stiffness(i, i))/m), structure%damping(i, i)/m)
         end associate
      end do
      is_stiff = rate*period > max_radians .and. rate > min_distance*highest
   end function is_stiff

   !> Most degrees of freedom that a method integrates.
   integer function largest_integrable(structure, method)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: method                                   !! an `integration_method`

      largest_integrable = max_dofs
      if (method /= integration_method%generalized_alpha) return
      if (has_sparse_steps(structure)) largest_integrable = max_sparse_dofs
   end function largest_integrable

   !> Whether cvode is available and supports the sliders of all laws.
   pure logical function has_bounds_of(system) result(has_bounds)
      type(system_t), intent(in) :: system
      integer :: i

      has_bounds = has_cvode()
      do i = 1, size(system%laws)
         select type (law => system%laws(i)%law)
         class is (hysteretic_law_t)
            has_bounds = has_bounds .and. law%has_bounds
         end select
      end do
   end function has_bounds_of

   !> Method with fixed steps for a system whose sliders `cvode` does not support: the only one for rigid laws, or the fastest.
   pure integer function fixed_step_method_of(system) result(method)
      type(system_t), intent(in) :: system
      integer :: i

      method = merge(integration_method%central_differences, integration_method%runge_kutta_4, &
                     any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))]))
   end function fixed_step_method_of

   !> Frequency of the fastest mode of the structure without damping [rad/s], 0 if not known.
   real(wp) function fastest_of(system) result(fastest)
      type(system_t), intent(in) :: system
      type(structure_t) :: structure

      fastest = 0.0_wp
      if (system%structure%n_dofs > max_dofs) return                  ! refused before any step
      structure = system%structure
      call structure%unpack()
      fastest = fastest_frequency(structure%mass, structure%stiffness)
   end function fastest_of
end module hb_integrable_system
