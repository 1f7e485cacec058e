!> Signs that feed energy into a structure or make it unstable at rest: deliberate in self-excited and bistable
!> models, otherwise a mistake.
module hb_sign_advice
   use hb_advice, only: advice, advice_list_t
   use hb_coordinate_scales, only: coordinate_scales_t, find_coordinate_scales
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgeev, dsygv
   use hb_law, only: law_t
   use hb_modes, only: modes_t, new_modes
   use hb_numbers, only: number_t, numbered_t
   use hb_structure, only: structure_t
   use hb_system, only: slowest_of, system_t
   use hb_text, only: rounded_to
   implicit none
   private
   public :: advise_on_signs, is_gyrator, numbers_of

   real(wp), parameter :: value_rounding = 1.0e-9_wp                  ! of an eigenvalue, relative to the largest entry
   real(wp), parameter :: entry_rounding = 1.0e-11_wp                 ! of an entry, likewise: rigid body modes of a reduction
   integer, parameter :: n_shown = 4                                  ! digits of a number
   integer, parameter :: max_dofs = 100                               ! of a structure whose eigenvalues take milliseconds
   integer, parameter :: max_dofs_with_damping = 20                   ! likewise, of a general problem of twice as many

contains

   !> Names damping and stiffness that are not positive semi-definite, and laws that damp with a negative coefficient. Damping is
   !> passed over in a search for self-excited motions and normal modes.
   subroutine advise_on_signs(system, list)
      type(system_t), intent(in) :: system
      type(advice_list_t), intent(inout) :: list
      real(wp), allocatable :: damping(:), mass(:), stiffness(:)      ! diagonals
      real(wp), allocatable :: dissipative(:, :)
      integer :: i

      associate (structure => system%structure)
         call structure%diagonals(mass, damping, stiffness)
         if (all(abs(mass) <= 0.0_wp) .and. all(abs(damping) <= 0.0_wp)) then
            call list%add(advice%no_inertia)
         else if (all(abs(mass) <= 0.0_wp)) then
            call list%add(advice%no_mass)
         end if
         if (.not. (is_gyroscopic(structure) .or. structure%depends_on_tuple())) &        ! links of sectors have no sign
            call advise_on_matrix(structure, "stiffness", stiffness, structure%stiffness, &
                                  [advice%negative_stiffness, advice%indefinite_stiffness], list)
         if (any(system%tones%is_unknown)) return
         call find_dissipative_part(system, dissipative)
         call advise_on_matrix(structure, "damping", damping, dissipative, &
                               [advice%negative_damping, advice%indefinite_damping], list)
         call advise_on_modes(structure, list)
      end associate
      do i = 1, size(system%laws)
         call advise_on_law(system%laws(i)%law, list)
      end do
   end subroutine advise_on_signs

   !> Names a mode that grows by an unsymmetric stiffness alone, and damping beyond the critical one in all modes.
   subroutine advise_on_modes(structure, list)
      type(structure_t), intent(in) :: structure
      type(advice_list_t), intent(inout) :: list
      type(modes_t) :: modes
      type(error_t), allocatable :: error
      real(wp), allocatable :: ratios(:)
      integer :: i

      if (structure%n_dofs > max_dofs_with_damping .or. allocated(structure%parts) .or. structure%depends_on_tuple()) return
      if (.not. (allocated(structure%stiffness) .and. allocated(structure%damping))) return
      associate (k => structure%stiffness, m => structure%mass)
         if (.not. all([(m(i, i) > 0.0_wp .and. k(i, i) > 0.0_wp, i=1, structure%n_dofs)])) return
         call new_modes(modes, m, structure%damping, k, error)
         if (allocated(error)) return
         if (modes%n_modes == 0) then
            call list%add(advice%no_oscillation)
            return
         end if
         if (.not. any(abs(k - transpose(k)) > value_rounding*maxval(abs(k)))) return
      end associate
      if (allocated(list%items)) then
         if (any(list%items%number == advice%negative_damping .or. list%items%number == advice%indefinite_damping)) return
      end if
      ratios = -modes%growth/hypot(modes%growth, modes%frequency)
      i = minloc(ratios, dim=1)
      if (ratios(i) < -value_rounding) &
         call list%add(advice%growing_mode, [rounded_to(modes%frequency(i), n_shown), rounded_to(ratios(i), n_shown)])
   end subroutine advise_on_modes

   !> The damping without what stores or passes on energy: the voltage of a coil, whose force is in another matrix, and a gyrator in
   !> any units damp nothing. Where the equations as they are would feed energy, they are multiplied so that forces are
   !> reciprocal, if that damps: those of a circuit may be no forces. Not allocated for sparse matrices.
   subroutine find_dissipative_part(system, damping)
      type(system_t), intent(in) :: system
      real(wp), allocatable, intent(out) :: damping(:, :)             !! (n_dofs, n_dofs)
      real(wp), allocatable :: reciprocal(:, :)                       !! likewise
      type(coordinate_scales_t) :: scales
      real(wp) :: lowest
      integer :: i, k

      associate (structure => system%structure)
         if (.not. allocated(structure%damping)) return
         allocate (damping, source=structure%damping)
         do k = 1, structure%n_dofs
            do i = 1, structure%n_dofs
               if (is_gyrator(structure, i, k)) damping(i, k) = 0.0_wp
            end do
         end do
         if (structure%n_dofs > max_dofs) return
         call find_lowest(damping, lowest)
         if (.not. is_negative(lowest, damping)) return
         call find_coordinate_scales(scales, structure, system%laws, slowest_of(system%tones), spread(0.0_wp, 1, structure%n_dofs))
         allocate (reciprocal, source=damping*spread(scales%equations, 2, structure%n_dofs))
      end associate
      call find_lowest(reciprocal, lowest)
      if (.not. is_negative(lowest, reciprocal)) call move_alloc(reciprocal, damping)
   end subroutine find_dissipative_part

   !> Whether two degrees of freedom act on each other by displacements in one direction and by rates in the other, as a current and
   !> the coil that it drives.
   pure logical function is_gyrator(structure, i, k)
      type(structure_t), intent(in) :: structure                      !! with dense matrices
      integer, intent(in) :: i, k

      is_gyrator = (acts(structure%stiffness, i, k) .and. acts(structure%damping, k, i)) .or. &
                   (acts(structure%stiffness, k, i) .and. acts(structure%damping, i, k))

   contains

      !> Whether the first is driven by the second, and not the reverse.
      pure logical function acts(matrix, row, column)
         real(wp), intent(in) :: matrix(:, :)
         integer, intent(in) :: row, column

         acts = abs(matrix(row, column)) > 0.0_wp .and. .not. abs(matrix(column, row)) > 0.0_wp
      end function acts
   end function is_gyrator

   !> Whether a structure has gyroscopic terms, which may stabilise it: in a rotating frame the stiffness contains -Omega**2 M.
   pure logical function is_gyroscopic(structure)
      type(structure_t), intent(in) :: structure

      is_gyroscopic = .false.
      if (allocated(structure%damping)) &
         is_gyroscopic = any(abs(structure%damping - transpose(structure%damping)) > value_rounding*maxval(abs(structure%damping)))
   end function is_gyroscopic

   !> Names a matrix with negative numbers on its diagonal or, if it is not large, with negative eigenvalues of its
   !> symmetric part. An unsymmetric stiffness, as of journal bearings, may have these, but no odd number of its own.
   subroutine advise_on_matrix(structure, name, diagonal, matrix, numbers, list)
      type(structure_t), intent(in) :: structure
      character(*), intent(in) :: name
      real(wp), intent(in) :: diagonal(:)                             !! (n_dofs)
      real(wp), intent(in), allocatable :: matrix(:, :)               !! (n_dofs, n_dofs); not allocated: sparse
      integer, intent(in) :: numbers(2)                               !! of `advice`: negative on the diagonal, and otherwise
      type(advice_list_t), intent(inout) :: list
      real(wp) :: lowest
      integer :: at

      at = minloc(diagonal, dim=1)
      if (diagonal(at) < -entry_rounding*maxval(abs(diagonal))) then
         call list%add(numbers(1), [diagonal(at)], structure%labels(at), unit_of(name, structure%units(at)))
         return
      end if
      if (structure%n_dofs > max_dofs .or. .not. allocated(matrix)) return
      if (name == "stiffness" .and. any(abs(matrix - transpose(matrix)) > value_rounding*maxval(abs(matrix)))) then
         call find_divergence(matrix, lowest, at)
      else
         call find_lowest(matrix, lowest, at)
      end if
      if (is_negative(lowest, matrix)) call list%add(numbers(2), [rounded_to(lowest, n_shown)], structure%labels(at))
   end subroutine advise_on_matrix

   !> The lowest eigenvalue of the symmetric part of a matrix, and the largest entry of its vector; 0 if it is not found.
   subroutine find_lowest(matrix, lowest, at)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(out) :: lowest
      integer, intent(out), optional :: at
      real(wp) :: a(size(matrix, 1), size(matrix, 1)), b(size(matrix, 1), size(matrix, 1))
      real(wp) :: values(size(matrix, 1)), work(3*size(matrix, 1))
      integer :: i, info

      a = 0.5_wp*(matrix + transpose(matrix))
      b = 0.0_wp
      do i = 1, size(values)
         b(i, i) = 1.0_wp
      end do
      call dsygv(1, "V", "U", size(values), a, size(values), b, size(values), values, work, size(work), info)
      lowest = merge(values(1), 0.0_wp, info == 0)
      if (present(at)) at = maxloc(abs(a(:, 1)), dim=1)
   end subroutine find_lowest

   !> The lowest real eigenvalue of an unsymmetric stiffness of which an odd number are negative, and the largest entry of its
   !> vector; otherwise 0. Its determinant is then negative, and whatever the damping, that of s**2 M + s D + K has a root s > 0.
   subroutine find_divergence(stiffness, lowest, at)
      real(wp), intent(in) :: stiffness(:, :)
      real(wp), intent(out) :: lowest
      integer, intent(out) :: at
      real(wp) :: a(size(stiffness, 1), size(stiffness, 1)), left(1, 1), shapes(size(stiffness, 1), size(stiffness, 1))
      real(wp), dimension(size(stiffness, 1)) :: imaginary_part, real_part
      real(wp) :: work(6*size(stiffness, 1))
      integer :: info

      at = 1
      lowest = 0.0_wp
      a = stiffness
      associate (n => size(a, 1))
         call dgeev("N", "V", n, a, n, real_part, imaginary_part, left, 1, shapes, n, work, size(work), info)
      end associate
      if (info /= 0) return
      where (abs(imaginary_part) > 0.0_wp) real_part = 0.0_wp         ! these come in pairs
      if (mod(count(real_part < -value_rounding*maxval(abs(stiffness))), 2) == 0) return
      lowest = minval(real_part)
      at = maxloc(abs(shapes(:, minloc(real_part, dim=1))), dim=1)
   end subroutine find_divergence

   !> Whether an eigenvalue of a matrix is below 0 by more than rounding.
   pure logical function is_negative(eigenvalue, matrix)
      real(wp), intent(in) :: eigenvalue, matrix(:, :)

      is_negative = eigenvalue < -value_rounding*maxval(abs(matrix))
   end function is_negative

   !> Unit of an entry of a matrix that belongs to a coordinate.
   pure function unit_of(name, coordinate) result(unit)
      character(*), intent(in) :: name, coordinate
      character(9) :: unit

      unit = "N/m"
      if (coordinate == "rad") unit = "N m/rad"
      if (name == "damping") unit = "N s/m"
      if (name == "damping" .and. coordinate == "rad") unit = "N m s/rad"
   end function unit_of

   !> Names a law that damps with negative coefficients alone.
   subroutine advise_on_law(law, list)
      class(law_t), intent(in) :: law
      type(advice_list_t), intent(inout) :: list
      character(11), parameter :: keys(2) = ["coefficient", "damping    "]
      real(wp) :: lowest(2)
      integer :: k

      if (.not. law%needs_velocity .or. law%is_users_own) return
      do k = 1, size(keys)
         lowest(k) = minval([0.0_wp, numbers_of(law, keys(k:k))])
      end do
      if (any(lowest < 0.0_wp) .and. .not. any(numbers_of(law, keys) > 0.0_wp)) &
         call list%add(advice%negative_law_damping, [minval(lowest)], law%label, keys(minloc(lowest, dim=1)))
   end subroutine advise_on_law

   !> The numbers of an object with one of these keys.
   function numbers_of(object, keys) result(values)
      class(numbered_t), intent(in) :: object
      character(*), intent(in) :: keys(:)
      real(wp), allocatable :: values(:)
      class(numbered_t), allocatable :: copy                          ! declarations may change an object
      type(number_t), allocatable :: numbers(:)
      real(wp) :: value
      logical :: is_found
      integer :: i

      allocate (values(0))
      allocate (copy, source=object)
      call copy%list_numbers(numbers)
      do i = 1, size(numbers)
         if (.not. any(numbers(i)%key == keys)) cycle
         call copy%find_number(numbers(i), value, is_found)
         if (is_found) values = [values, value]
      end do
   end function numbers_of
end module hb_sign_advice
