!> Chain of masses in a line, each coupled to the next one by a spring and optionally to the ground by another.
module hb_chain
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_proportional_damping, only: proportional_damping_t, read_proportional_damping
   use hb_sparse, only: sparse_from_entries, sparse_sum, sparse_t
   use hb_structure, only: check_memory_of_structure, label_length, most_dense, new_structure, structure_t, unit_length
   use hb_text, only: to_text
   implicit none
   private
   public :: new_chain, read_chain

contains

   !> Reads the chain from the keys of its group `&structure`; a single value applies to all masses or springs.
   subroutine read_chain(group, structure, error, memory_limit)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit         !! bytes
      type(proportional_damping_t) :: damping
      real(wp), allocatable :: coupling_stiffness(:), ground_stiffness(:), mass(:)
      character(:), allocatable :: ends
      integer :: n_masses

      call group%get("n_masses", n_masses)
      call group%get("ends", ends)
      call group%get("mass", mass)
      call group%get("coupling_stiffness", coupling_stiffness)
      call group%get("ground_stiffness", ground_stiffness)
      call read_proportional_damping(group, damping)
      if (n_masses > 0) then
         call spread_value(group, "mass", mass, n_masses)
         call spread_value(group, "coupling_stiffness", coupling_stiffness, n_springs(n_masses, ends))
         call spread_value(group, "ground_stiffness", ground_stiffness, n_masses)
      end if
      call group%finish(error)
      if (allocated(error)) return
      call check_memory_of_structure(min(n_masses, most_dense), error, memory_limit)
      if (.not. allocated(error)) then
         call new_chain(structure, mass, coupling_stiffness, ground_stiffness, ends, damping, error)
      end if
      call annotate(error, group%location())
   end subroutine read_chain

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

   !> Repeats a single value `n` times; a number of values other than 1 or `n` is a problem of the key.
   subroutine spread_value(group, key, values, n)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in) :: n
      character(:), allocatable :: wanted

      if (.not. allocated(values)) return                    ! already a problem of the group
      if (size(values) == 1) then
         values = spread(values(1), 1, n)
      else if (size(values) /= n) then
         wanted = "1 value"
         if (n /= 1) wanted = "1 or "//to_text(n)//" values"
         call group%problem(key, "needs "//wanted//", there are "//to_text(size(values)))
      end if
   end subroutine spread_value
end module hb_chain
