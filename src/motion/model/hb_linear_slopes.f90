!> Derivatives of the linear part of a model by numbers that move: of its matrices before condensation and of its loads, at
!> constant frequencies, and of the reaction that follows from them.
!> Matrices and loads are built beside the point; their difference is exact if they are affine functions of the number. Source:
!> docs/why/theory.md, section 6.7.
module hb_linear_slopes
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_balance, only: balance_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_model, only: model_t
   use hb_model_number, only: model_number_t
   use hb_model_numbers, only: build_beside
   use hb_movement, only: add_linear_numbers, movement_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_system, only: coordinates_of
   use hb_thresholds, only: difference_step
   implicit none
   private
   public :: beside_t, find_slopes_between, find_slopes_by, linear_slopes_t, reaction_slope

   !> Values of numbers of structure and loads beside a point.
   type :: beside_t
      real(wp) :: position = 0.0_wp                                   !! relative to the point
      type(model_number_t), allocatable :: numbers(:)
      real(wp), allocatable :: values(:)
   contains
      procedure :: add => beside_add
   end type beside_t

   !> Derivatives of structure and loads.
   type :: linear_slopes_t
      type(structure_t), allocatable :: structure                     !! not allocated: zero
      type(amplitudes_t) :: loads                                     !! [N], zero if the numbers cannot move
      logical :: is_possible = .false.                                !! they can move
   end type linear_slopes_t

   !> The structure and its loads beside a point.
   type :: side_t
      real(wp) :: position = 0.0_wp                                   ! relative to the point
      type(structure_t) :: structure
      type(amplitudes_t) :: loads                                     ! [N]
   end type side_t

contains

   !> Adds the numbers of structure and loads that move with a value.
   subroutine beside_add(self, movement, value)
      class(beside_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value

      if (.not. allocated(self%numbers)) allocate (self%numbers(0), self%values(0))
      call add_linear_numbers(movement, value, self%numbers, self%values)
   end subroutine beside_add

   !> Finds the derivatives by the value of a movement.
   subroutine find_slopes_by(model, movement, value, typical, slopes)
      type(model_t), intent(inout) :: model                           !! unchanged
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value, typical                          !! its present one; > 0
      type(linear_slopes_t), intent(out) :: slopes
      type(beside_t) :: sides(2)
      integer :: i

      do i = 1, 2
         sides(i)%position = (3 - 2*i)*(typical*merge(0.5_wp, difference_step, movement%is_affine))
         call sides(i)%add(movement, value + sides(i)%position)
      end do
      call find_slopes_between(model, sides, movement%structure, slopes)
   end subroutine find_slopes_by

   !> Finds the difference quotients of two sides, those of the point itself at the end of the range of a number.
   subroutine find_slopes_between(model, sides, has_structure, slopes)
      type(model_t), intent(inout) :: model                           !! unchanged
      type(beside_t), intent(in) :: sides(2)
      logical, intent(in) :: has_structure                            !! its matrices move
      type(linear_slopes_t), intent(out) :: slopes
      type(side_t) :: built(2)
      real(wp) :: once(model%discretisation%harmonics%n_harmonics), weight
      integer :: i

      call new_amplitudes(slopes%loads, model%system%structure%n_dofs, size(once))
      do i = 1, 2
         if (.not. allocated(sides(i)%numbers)) return
         if (size(sides(i)%numbers) == 0) return
         call build_side(model, sides(i), built(i))
      end do
      slopes%is_possible = abs(built(1)%position - built(2)%position) > 0.0_wp
      if (.not. slopes%is_possible) return
      weight = 1.0_wp/(built(1)%position - built(2)%position)
      once = 1.0_wp
      if (has_structure) slopes%structure = built(1)%structure%change_from(built(2)%structure, weight)
      call slopes%loads%add_scaled(built(1)%loads, weight*once)
      call slopes%loads%add_scaled(built(2)%loads, -weight*once)
   end subroutine find_slopes_between

   !> Structure and loads beside the present point; those at the point at the end of the range of a number.
   subroutine build_side(model, beside, side)
      type(model_t), intent(inout) :: model
      type(beside_t), intent(in) :: beside
      type(side_t), intent(out) :: side
      type(error_t), allocatable :: error
      type(spectrum_t) :: loads

      side%position = beside%position
      call build_beside(model, beside%numbers, beside%values, side%structure, loads, error)
      associate (set => model%discretisation%harmonics)
         side%loads = loads%in_set(set)
         if (allocated(error)) side = side_t(0.0_wp, model%system%structure, model%system%loads_in(set))
      end associate
   end subroutine build_side

   !> Derivative of the reaction at constant motion; zero if the structure is singular.
   function reaction_slope(balance, model, slopes, x) result(slope)
      class(balance_t), intent(in) :: balance
      type(model_t), intent(in) :: model                              !! that of the balance
      type(linear_slopes_t), intent(in) :: slopes
      real(wp), intent(in) :: x(:)
      real(wp) :: slope(size(x))
      type(dynamic_stiffness_t) :: stiffness
      type(error_t), allocatable :: error
      type(linear_part_t) :: linear
      type(wanted_slopes_t) :: wanted
      real(wp) :: along(balance%harmonics%n_coefficients, balance%n_dofs), once(balance%harmonics%n_harmonics)

      if (.not. allocated(slopes%structure)) then
         slope = slope_of_loads(balance, model, slopes%loads)
         return
      end if
      slope = 0.0_wp
      once = 1.0_wp
      wanted%is_on = .true.
      wanted%change = slopes%structure
      wanted%drives = balance%drives()
      wanted%rates = 0.0_wp*balance%frequencies
      wanted%loads = slopes%loads
      call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), balance%frequencies, &
                                 model%system%loads_in(model%discretisation%harmonics), error, wanted, &
                                 balance%harmonics%tuples)
      if (allocated(error)) return
      call new_linear_part(linear, stiffness)
      call linear%find_reaction_slope(balance%harmonics, reshape(x, shape(along)), 1.0_wp, once, along)
      slope = [along]
   end function reaction_slope

   !> The part of loads in it: the condensed derivatives of the loads, of the harmonics that have any; of contacts of a whole model
   !> the forces of these in the motion, see hb_linear_part.
   function slope_of_loads(balance, model, loads) result(slope)
      class(balance_t), intent(in) :: balance
      type(model_t), intent(in) :: model
      type(amplitudes_t), intent(in) :: loads                         !! their derivatives
      real(wp) :: slope(balance%n_unknowns)
      type(dynamic_stiffness_t) :: stiffness
      type(error_t), allocatable :: error
      type(wanted_slopes_t) :: wanted
      complex(wp), allocatable :: motion(:, :)
      complex(wp) :: along(balance%n_dofs, balance%harmonics%n_harmonics)

      if (allocated(balance%stiffness%contacts)) then
         call balance%stiffness%contacts%response_to(loads, motion)
         slope = [balance%harmonics%coefficients(balance%stiffness%magnitude*motion)]
         return
      end if
      along = (0.0_wp, 0.0_wp)
      associate (positions => loads%harmonics)
         wanted%of_interior = .false.
         wanted%drives = balance%drives()
         wanted%drives = wanted%drives(positions)
         call new_dynamic_stiffness(stiffness, model%system%structure, balance%stiffness%coordinates, &
                                    balance%frequencies(positions), loads%at(positions), error, wanted, &
                                    balance%harmonics%tuples(:, positions))
         if (.not. allocated(error)) along(:, positions) = stiffness%load
      end associate
      slope = [balance%harmonics%coefficients(along)]
   end function slope_of_loads
end module hb_linear_slopes
