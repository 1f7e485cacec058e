!> Warnings about signs that feed energy into a structure or make it unstable at rest: deliberate in self-excited and bistable
!> models, otherwise a mistake.
module hb_sign_warnings
   use hb_coordinate_scales, only: coordinate_scales_t, find_coordinate_scales
   use hb_kinds, only: wp
   use hb_lapack, only: dsygv
   use hb_law, only: law_t
   use hb_numbers, only: number_t
   use hb_structure, only: structure_t
   use hb_system, only: slowest_of, system_t
   use hb_text, only: add_string, rounded_to, string_t, to_text
   implicit none
   private
   public :: describe_signs, is_gyrator

   real(wp), parameter :: rounding = 1.0e-9_wp                        ! of an eigenvalue, relative to the largest entry
   real(wp), parameter :: zero = 1.0e-11_wp                           ! of an entry, likewise: rigid body modes of a reduction
   integer, parameter :: n_shown = 4                                  ! digits of a number
   integer, parameter :: max_dofs = 100                               ! of a structure whose eigenvalues take milliseconds
   character(*), parameter :: feeding = "energy is fed into vibrations; unless the motion is to be self-excited, "
   character(*), parameter :: remedy = "make it positive"
   character(*), parameter :: without_inertia = "all masses and dampings of the structure are zero: it follows its loads as in "// &
      "statics, at any frequency; unless that is meant, give the masses"
   character(*), parameter :: without_mass = "all masses of the structure are zero: springs and dashpots follow their loads "// &
      "without a resonance; unless that is meant, give the masses"
   character(*), parameter :: unstable = "the equilibrium is unstable; unless the structure is to be buckled, "

contains

   !> Returns a line for each of damping and stiffness that are not positive semi-definite, and for each law that damps with a
   !> negative coefficient. Damping is passed over in a search for self-excited motions and normal modes.
   subroutine describe_signs(system, lines)
      type(system_t), intent(in) :: system
      type(string_t), allocatable, intent(out) :: lines(:)
      real(wp), allocatable :: damping(:), mass(:), stiffness(:)      ! diagonals
      integer :: i

      allocate (lines(0))
      associate (structure => system%structure)
         call structure%diagonals(mass, damping, stiffness)
         if (all(abs(mass) <= 0.0_wp) .and. all(abs(damping) <= 0.0_wp)) then
            call add_string(lines, without_inertia)
         else if (all(abs(mass) <= 0.0_wp)) then
            call add_string(lines, without_mass)
         end if
         if (.not. is_gyroscopic(structure)) &
            call describe_matrix(structure, "stiffness", stiffness, structure%stiffness, unstable, lines)
         if (any(system%tones%is_unknown)) return
         call describe_matrix(structure, "damping", damping, dissipative_part(system), feeding, lines)
      end associate
      do i = 1, size(system%laws)
         call describe_law(system%laws(i)%law, lines)
      end do
   end subroutine describe_signs

   !> The damping without what stores or passes on energy, with equations multiplied so that forces are reciprocal: the voltage of a
   !> coil, whose force is in another matrix, and a gyrator in any units damp nothing. Not allocated for sparse matrices.
   function dissipative_part(system) result(damping)
      type(system_t), intent(in) :: system
      real(wp), allocatable :: damping(:, :)
      type(coordinate_scales_t) :: scales
      integer :: i, k

      associate (structure => system%structure)
         if (.not. allocated(structure%damping)) return
         call find_coordinate_scales(scales, structure, system%laws, slowest_of(system%tones), spread(0.0_wp, 1, structure%n_dofs))
         allocate (damping, source=structure%damping*spread(scales%equations, 2, structure%n_dofs))
         do k = 1, structure%n_dofs
            do i = 1, structure%n_dofs
               if (is_gyrator(structure, i, k)) damping(i, k) = 0.0_wp
            end do
         end do
      end associate
   end function dissipative_part

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
         is_gyroscopic = any(abs(structure%damping - transpose(structure%damping)) > rounding*maxval(abs(structure%damping)))
   end function is_gyroscopic

   !> Adds a line on a matrix with negative numbers on its diagonal or, if it is not large, with negative eigenvalues of its
   !> symmetric part. An unsymmetric stiffness, as of journal bearings, may have these.
   subroutine describe_matrix(structure, name, diagonal, matrix, meaning, lines)
      type(structure_t), intent(in) :: structure
      character(*), intent(in) :: name, meaning
      real(wp), intent(in) :: diagonal(:)                             !! (n_dofs)
      real(wp), intent(in), allocatable :: matrix(:, :)               !! (n_dofs, n_dofs); not allocated: sparse
      type(string_t), allocatable, intent(inout) :: lines(:)
      real(wp), allocatable :: a(:, :), b(:, :), values(:), work(:)
      integer :: at, i, info

      at = minloc(diagonal, dim=1)
      if (diagonal(at) < -zero*maxval(abs(diagonal))) then
         call add_string(lines, "the "//name//" of '"//trim(structure%labels(at))//"' is negative, "//to_text(diagonal(at))//" "// &
                         trim(unit_of(name, structure%units(at)))//": "//meaning//remedy)
         return
      end if
      if (structure%n_dofs > max_dofs .or. .not. allocated(matrix)) return
      if (name == "stiffness" .and. any(abs(matrix - transpose(matrix)) > rounding*maxval(abs(matrix)))) return
      allocate (a, source=0.5_wp*(matrix + transpose(matrix)))
      allocate (b(size(a, 1), size(a, 1)), source=0.0_wp)
      do i = 1, size(a, 1)
         b(i, i) = 1.0_wp
      end do
      allocate (values(size(a, 1)), work(3*size(a, 1)))
      call dsygv(1, "V", "U", size(a, 1), a, size(a, 1), b, size(a, 1), values, work, size(work), info)
      if (info /= 0) return
      if (values(1) >= -rounding*maxval(abs(values))) return
      at = maxloc(abs(a(:, 1)), dim=1)
      call add_string(lines, "the "//name//" matrix has a negative eigenvalue, "//to_text(rounded_to(values(1), n_shown))// &
                      ", whose vector is largest at '"// &
                      trim(structure%labels(at))//"': "//meaning//"make it positive semi-definite")
   end subroutine describe_matrix

   !> Unit of an entry of a matrix that belongs to a coordinate.
   pure function unit_of(name, coordinate) result(unit)
      character(*), intent(in) :: name, coordinate
      character(9) :: unit

      unit = "N/m"
      if (coordinate == "rad") unit = "N m/rad"
      if (name == "damping") unit = "N s/m"
      if (name == "damping" .and. coordinate == "rad") unit = "N m s/rad"
   end function unit_of

   !> Adds a line on a law that damps with negative coefficients alone.
   subroutine describe_law(given, lines)
      class(law_t), intent(in) :: given
      type(string_t), allocatable, intent(inout) :: lines(:)
      class(law_t), allocatable :: law
      type(number_t), allocatable :: numbers(:)
      real(wp) :: highest, lowest, value
      character(:), allocatable :: key
      logical :: is_found
      integer :: i

      if (.not. given%needs_velocity .or. given%is_users_own) return
      allocate (law, source=given)
      call law%list_numbers(numbers)
      highest = 0.0_wp
      lowest = 0.0_wp
      key = ""
      do i = 1, size(numbers)
         if (.not. any(numbers(i)%key == [character(11) :: "coefficient", "damping"])) cycle
         call law%find_number(numbers(i), value, is_found)
         if (.not. is_found) cycle
         if (value < lowest) key = trim(numbers(i)%key)
         lowest = min(lowest, value)
         highest = max(highest, value)
      end do
      if (len(key) > 0 .and. .not. highest > 0.0_wp) call add_string(lines, "law '"//law%label//"': "//key//" = "// &
                                                                   to_text(lowest)//" is negative: "//feeding//remedy)
   end subroutine describe_law
end module hb_sign_warnings
