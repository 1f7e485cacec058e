!> Chain of masses in a line, each coupled to the next one by a spring and optionally to the ground by another.
module hb_chain
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_sparse, only: sparse_from_entries, sparse_sum, sparse_t
   use hb_structure, only: check_memory_of_structure, label_length, max_dense, new_structure, structure_t, unit_length
   use hb_structure_builder, only: matrix_slope_t, structure_builder_t
   use hb_text, only: to_text
   implicit none
   private
   public :: chain_t, n_springs, new_chain

   !> The chain as given: one value applies to all masses or springs.
   type, extends(structure_builder_t) :: chain_t
      integer :: n_masses = 0
      character(:), allocatable :: ends                      !! as for `new_chain`
      real(wp), allocatable :: mass(:)                       !! [kg]
      real(wp), allocatable :: coupling_stiffness(:)         !! [N/m]
      real(wp), allocatable :: ground_stiffness(:)           !! [N/m]
   contains
      procedure :: declare_numbers => chain_declare_numbers
      procedure :: is_affine_in => chain_is_affine_in
      procedure :: build => chain_build
      procedure :: find_slope => chain_find_slope
   end type chain_t

contains

   subroutine chain_declare_numbers(self, numbers)
      class(chain_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("mass", self%mass)
      call numbers%add("coupling_stiffness", self%coupling_stiffness)
      call numbers%add("ground_stiffness", self%ground_stiffness)
      call self%proportional%declare_numbers(numbers)
   end subroutine chain_declare_numbers

   pure logical function chain_is_affine_in(self, number) result(is_affine)
      class(chain_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = .true.
   end function chain_is_affine_in

   subroutine chain_build(self, structure, error, memory_limit)
      class(chain_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit

      call check_memory_of_structure(min(self%n_masses, max_dense), error, memory_limit)
      if (allocated(error)) return
      call new_chain(structure, for_each(self%mass, self%n_masses), &
                     for_each(self%coupling_stiffness, n_springs(self%n_masses, self%ends)), &
                     for_each(self%ground_stiffness, self%n_masses), self%ends, self%proportional, error)
   end subroutine chain_build

   !> Derivatives by one of several masses or springs.
   subroutine chain_find_slope(self, number, slope, is_known)
      class(chain_t), intent(in) :: self
      type(number_t), intent(in) :: number
      type(matrix_slope_t), intent(inout) :: slope
      logical, intent(out) :: is_known
      integer :: left, right

      call slope%begin()
      is_known = number%element(1) > 0
      select case (number%key)
      case ("mass")
         is_known = is_known .and. size(self%mass) > 1
         if (is_known) call slope%add(number%element(1), number%element(1), 1.0_wp, 0.0_wp, self%proportional%mass)
      case ("ground_stiffness")
         is_known = is_known .and. size(self%ground_stiffness) > 1
         if (is_known) call slope%add(number%element(1), number%element(1), 0.0_wp, 1.0_wp, self%proportional%stiffness)
      case ("coupling_stiffness")
         is_known = is_known .and. size(self%coupling_stiffness) > 1
         if (.not. is_known) return
         left = number%element(1) - merge(0, 1, self%ends == "free")
         right = left + 1
         call add(left, left, 1.0_wp)
         call add(right, right, 1.0_wp)
         call add(left, right, -1.0_wp)
         call add(right, left, -1.0_wp)
      case default
         is_known = .false.
      end select

   contains

      subroutine add(i, j, stiffness)
         integer, intent(in) :: i, j
         real(wp), intent(in) :: stiffness

         if (min(i, j) < 1 .or. max(i, j) > self%n_masses) return
         call slope%add(i, j, 0.0_wp, stiffness, stiffness*self%proportional%stiffness)
      end subroutine add
   end subroutine chain_find_slope

   !> Repeats a single value `n` times.
   pure function for_each(values, n)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n
      real(wp), allocatable :: for_each(:)

      if (size(values) == 1) then
         for_each = spread(values(1), 1, n)
      else
         for_each = values
      end if
   end function for_each

   !> Creates a chain; fails if a number of springs does not match the number of masses.
   subroutine new_chain(structure, mass, coupling_stiffness, ground_stiffness, ends, damping, error)
      type(structure_t), intent(out) :: structure
      real(wp), intent(in) :: mass(:)                        !! [kg], (n_masses), from the left
      real(wp), intent(in) :: coupling_stiffness(:)   !! [N/m], from the left; a fixed end has a spring to the wall
      real(wp), intent(in) :: ground_stiffness(:)            !! [N/m], (n_masses)
      character(*), intent(in) :: ends              !! `fixed`, `free`, or `fixed-free`: the left end is fixed
      type(proportional_damping_t), intent(in) :: damping
      type(error_t), allocatable, intent(out) :: error
      type(sparse_t) :: mass_matrix, stiffness
      integer, allocatable :: all_dofs(:)
      character(label_length), allocatable :: labels(:)
      character(unit_length), allocatable :: units(:)
      integer :: first, i, n

      n = size(mass)
      if (size(coupling_stiffness) /= n_springs(n, ends) .or. size(ground_stiffness) /= n) then
         call fail(error, "chain: "//to_text(n)//" masses with ends '"//trim(ends)//"' need "// &
                   to_text(n_springs(n, ends))//" coupling and "//to_text(n)//" ground springs, not "// &
                   to_text(size(coupling_stiffness))//" and "//to_text(size(ground_stiffness)))
         return
      end if

      allocate (labels(n), units(n))
      units = "m"
      do i = 1, n
         labels(i) = "x"//to_text(i)
      end do
      all_dofs = [(i, i=1, n)]
      mass_matrix = sparse_from_entries(n, all_dofs, all_dofs, mass)
      first = merge(1, 0, ends == "free")                    ! 0 is the wall
      stiffness = sparse_sum(1.0_wp, sparse_from_entries(n, all_dofs, all_dofs, ground_stiffness), 1.0_wp, &
                             springs(n, first, coupling_stiffness))
      call new_structure(structure, mass_matrix, damping%matrix(mass_matrix, stiffness), stiffness, labels, &
                         units, error)
   end subroutine new_chain

   !> Stiffness matrix of springs from mass `first` to the next and so on; 0 and n + 1 are walls.
   function springs(n, first, k) result(stiffness)
      integer, intent(in) :: n, first
      real(wp), intent(in) :: k(:)                           !! [N/m]
      type(sparse_t) :: stiffness
      integer :: column(4*size(k)), row(4*size(k))
      real(wp) :: value(4*size(k))
      integer :: i, m

      m = 0
      do i = 1, size(k)
         associate (left => first + i - 1, right => first + i)
            call add(left, left, k(i))
            call add(right, right, k(i))
            call add(left, right, -k(i))
            call add(right, left, -k(i))
         end associate
      end do
      stiffness = sparse_from_entries(n, row(:m), column(:m), value(:m))

   contains

      subroutine add(i, j, k)
         integer, intent(in) :: i, j
         real(wp), intent(in) :: k

         if (min(i, j) < 1 .or. max(i, j) > n) return
         m = m + 1
         row(m) = i
         column(m) = j
         value(m) = k
      end subroutine add
   end function springs

   !> Number of coupling springs, those to a wall included.
   pure integer function n_springs(n_masses, ends)
      integer, intent(in) :: n_masses
      character(*), intent(in) :: ends

      select case (ends)
      case ("fixed")
         n_springs = n_masses + 1
      case ("fixed-free")
         n_springs = n_masses
      case default                                           ! free
         n_springs = n_masses - 1
      end select
   end function n_springs
end module hb_chain
