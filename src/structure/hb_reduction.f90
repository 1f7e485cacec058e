!> A small structure in place of a large one, the same at some places: by Galerkin's projection on a Krylov basis (hb_krylov_basis),
!> which grows until the flexibility at these places no longer changes.
!>
!> Its degrees of freedom are the kept ones, as they were, then coordinates q of shapes in which these rest. Of the latter, mass and
!> stiffness are diagonal, so that they cost next to nothing at each frequency: with C the rows of V at the kept degrees of freedom,
!> C^T = Q1 R1, and the orthogonal complement Q2 of Q1,
!>
!>     x = V (Q1 R1^-T z + Q2 U q),   Q2^T (V^T M V) Q2 = U theta U^T,   K_s = diag((R1^T R1)^-1, 1).
module hb_reduction
   use hb_clock, only: wall_clock
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_krylov_basis, only: krylov_basis_t, new_krylov_basis
   use hb_lapack, only: dgemm, dgeqrf, dorgqr, dsyev, dtrsm
   use hb_node_sets, only: named_vectors_t
   use hb_sparse, only: sparse_t
   use hb_structure, only: label_length, new_structure, reach_t, structure_t, unit_length
   use hb_text, only: to_text
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: reduce_structure

   integer, parameter :: largest_basis = 2000
   integer, parameter :: most_places = 60                             ! of damping and stiffness, kept for their own sake
   real(wp), parameter :: shift_to_highest = 0.1_wp                   ! s relative to the highest frequency

contains

   !> Reduces a structure with sparse matrices to some of its degrees of freedom and as many shapes as the flexibility there takes,
   !> also under the named loads. Fails where the stiffness is indefinite, or where too many shapes would be needed.
   subroutine reduce_structure(full, kept, loads, up_to, most_bytes, small, error, recovery)
      type(structure_t), intent(in) :: full
      integer, intent(in) :: kept(:)                                  !! degrees of freedom, each once
      type(named_vectors_t), intent(in) :: loads                      !! that the small structure has by name
      real(wp), intent(in) :: up_to                                   !! [rad/s]
      real(wp), intent(in) :: most_bytes                              !! of memory that there are
      type(structure_t), intent(out) :: small
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out), optional :: recovery(:, :)  !! all degrees of freedom of the full structure by those of
                                                                      !! the small one, transposed, (small%n_dofs, full%n_dofs)
      type(krylov_basis_t) :: basis
      integer, allocatable :: places(:)
      real(wp), allocatable :: transformation(:, :)
      real(wp) :: bytes, error_left_out, started
      logical :: rests_are_kept

      started = wall_clock()
      associate (matrices => full%sparse)
         call new_krylov_basis(basis, matrices%mass, matrices%damping, matrices%stiffness, inputs_of(full%n_dofs, kept, loads), &
                               (shift_to_highest*up_to)**2, most_bytes, error)
      end associate
      if (.not. allocated(error)) then
         places = kept
         call keep_places_of_rests(basis, places, rests_are_kept)
         call grow(basis, up_to, full%reduction%tolerance, rests_are_kept, error_left_out, error)
      end if
      bytes = basis%bytes_of_factors()
      call basis%destroy()
      if (.not. allocated(error)) call find_transformation(basis, places, transformation, error)
      if (.not. allocated(error)) call make_small(full, basis, places, loads, transformation, rests_are_kept, small, error)
      call annotate(error, "reduction of the structure to its flexibility")
      small%reduction%bytes = bytes
      if (allocated(error)) return
      small%reduction = full%reduction
      small%reduction%bytes = bytes
      small%reduction%n_full = full%n_dofs
      small%reduction%reach = reach_t(.true., up_to)
      small%reduction%error = error_left_out
      small%reduction%seconds = wall_clock() - started
      if (.not. present(recovery)) return
      allocate (recovery(basis%n, full%n_dofs))
      call dgemm("T", "T", basis%n, full%n_dofs, basis%n, 1.0_wp, transformation, basis%n, basis%v, size(basis%v, 1), 0.0_wp, &
                 recovery, basis%n)
   end subroutine reduce_structure

   !> Unit forces at the kept degrees of freedom, then the loads.
   pure function inputs_of(n_dofs, kept, loads) result(inputs)
      integer, intent(in) :: n_dofs, kept(:)
      type(named_vectors_t), intent(in) :: loads
      real(wp), allocatable :: inputs(:, :)
      integer :: e, i, n_loads

      n_loads = 0
      if (allocated(loads%names)) n_loads = size(loads%names)
      allocate (inputs(n_dofs, size(kept) + n_loads), source=0.0_wp)
      do i = 1, size(kept)
         inputs(kept(i), i) = 1.0_wp
      end do
      do i = 1, n_loads
         do e = loads%first(i), loads%first(i + 1) - 1
            inputs(loads%dofs(e), size(kept) + i) = inputs(loads%dofs(e), size(kept) + i) + loads%values(e)
         end do
      end do
   end function inputs_of

   !> Keeps the few places where damping or stiffness is not that of a plain structure, such as dashpots and bearings: what acts
   !> there alone is exact then, and leaves the shapes without coupling.
   subroutine keep_places_of_rests(basis, places, are_kept)
      type(krylov_basis_t), intent(inout) :: basis
      integer, allocatable, intent(inout) :: places(:)
      logical, intent(out) :: are_kept                                !! false where these are many
      integer, allocatable :: more(:)
      real(wp), allocatable :: inputs(:, :)
      logical :: is_touched(size(basis%inputs, 1))
      integer :: i

      is_touched = .false.
      call touch(basis%remainder_of_damping)
      call touch(basis%remainder_of_stiffness)
      are_kept = count(is_touched) <= most_places
      if (.not. are_kept) return
      is_touched(places) = .false.
      more = pack([(i, i=1, size(is_touched))], is_touched)
      if (size(more) == 0) return
      allocate (inputs(size(basis%inputs, 1), size(basis%inputs, 2) + size(more)), source=0.0_wp)
      inputs(:, :size(basis%inputs, 2)) = basis%inputs
      do i = 1, size(more)
         inputs(more(i), size(basis%inputs, 2) + i) = 1.0_wp
      end do
      call move_alloc(inputs, basis%inputs)
      places = [places, more]

   contains

      subroutine touch(matrix)
         type(sparse_t), intent(in) :: matrix
         integer :: row

         do row = 1, matrix%n_rows
            if (matrix%n_in_row(row) > 0) is_touched(row) = .true.
            is_touched(matrix%column(matrix%first(row):matrix%first(row + 1) - 1)) = .true.
         end do
      end subroutine touch
   end subroutine keep_places_of_rests

   !> Adds blocks until the last one has changed nothing, at frequencies that are looked at each time and at others.
   subroutine grow(basis, up_to, tolerance, rests_are_kept, error_left_out, error)
      type(krylov_basis_t), intent(inout) :: basis
      real(wp), intent(in) :: up_to, tolerance
      logical, intent(in) :: rests_are_kept                           !! else the space takes them in by residuals, in the end
      real(wp), intent(out) :: error_left_out
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: golden = 0.381966_wp, first_tolerance = 1.0e-2_wp
      integer, parameter :: n_residuals = 4
      real(wp) :: change
      integer :: i, n_cycles

      n_cycles = 0
      do
         call basis%extend(error)
         if (allocated(error)) return
         error_left_out = epsilon(1.0_wp)
         if (basis%n == basis%n_before) return                        ! nothing new: the space is whole
         change = basis%change(frequencies_below(basis, up_to, 0.0_wp))
         if (work_is_over()) exit
         if (change <= tolerance .and. (rests_are_kept .or. n_cycles > 0)) then
            error_left_out = max(change, basis%change(frequencies_below(basis, up_to, golden)))
            if (work_is_over()) exit
            if (error_left_out <= tolerance) return
            change = error_left_out
         end if
         if (basis%n > largest_basis) exit
         if (rests_are_kept .or. (n_cycles == 0 .and. change > first_tolerance)) cycle
         n_cycles = n_cycles + 1
         call basis%take_residuals([(up_to*(i - modulo(golden*n_cycles, 1.0_wp))/n_residuals, i=1, n_residuals)])
      end do
      if (work_is_over()) then
         call fail(error, "the reduction was ended before its time")
         return
      end if
      call fail(error, to_text(basis%n)//" shapes leave an error of "//to_text(change)//" up to "//to_text(up_to)// &
                " rad/s, flexibility_tolerance is "//to_text(tolerance)//"; raise it, lower flexibility_up_to or the "// &
                "order of the harmonics, or use flexibility = 'exact'")
   end subroutine grow

   !> Frequencies evenly up to the highest, and beside the resonances, where a flexibility changes most.
   function frequencies_below(basis, up_to, offset) result(frequencies)
      type(krylov_basis_t), intent(in) :: basis
      real(wp), intent(in) :: up_to
      real(wp), intent(in) :: offset                                  !! of the grid, from 0 to 1
      real(wp), allocatable :: frequencies(:)
      real(wp), parameter :: beside = 1.001_wp
      real(wp), allocatable :: poles(:)
      integer :: i, n_even, n_poles

      n_even = 48
      n_poles = 48
      if (basis%remainder_of_damping%n_entries() + basis%remainder_of_stiffness%n_entries() > 0) then
         n_even = 12                                                  ! each takes a dense factorisation
         n_poles = 12
      end if
      poles = basis%poles()
      poles = pack(poles, poles < up_to)
      frequencies = [(up_to*(real(i, wp) - offset)/n_even, i=1, n_even)]
      n_poles = min(n_poles, size(poles))
      frequencies = [frequencies, [((beside + 0.1_wp*offset)*poles(1 + ((i - 1)*size(poles))/n_poles), i=1, n_poles)]]
   end function frequencies_below

   !> T = (Q1 R1^-T, Q2 U).
   subroutine find_transformation(basis, places, transformation, error)
      type(krylov_basis_t), intent(in) :: basis
      integer, intent(in) :: places(:)
      real(wp), allocatable, intent(out) :: transformation(:, :)      !! (basis%n, basis%n)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: q(:, :), r(:, :), mass(:, :), tau(:), theta(:), work(:)
      integer :: i, info, n, p

      n = basis%n
      p = size(places)
      if (p > n) then
         call fail(error, "there are more kept degrees of freedom than shapes; some depend on each other")
         return
      end if
      allocate (q(n, n), r(p, p), tau(p), work(64*n + 1))
      q(:, :p) = transpose(basis%v(places, :n))
      call dgeqrf(n, p, q, n, tau, work, size(work), info)
      r = q(:p, :p)
      call dorgqr(n, n, p, q, n, tau, work, size(work), info)
      do i = 1, p
         if (abs(r(i, i)) <= epsilon(1.0_wp)*norm2(r(:i, i))) then
            call fail(error, "kept degrees of freedom move in proportion to each other; leave one of them out")
            return
         end if
      end do
      associate (n_inner => n - p)
         mass = matmul(transpose(q(:, p + 1:)), matmul(basis%mass(:n, :n), q(:, p + 1:)))
         allocate (theta(n_inner))
         call dsyev("V", "U", n_inner, mass, max(1, n_inner), theta, work, size(work), info)
         q(:, p + 1:) = matmul(q(:, p + 1:), mass)
         if (p > 0) call dtrsm("R", "U", "T", "N", n, p, 1.0_wp, r, p, q, n)
      end associate
      call move_alloc(q, transformation)
   end subroutine find_transformation

   !> The small structure in its coordinates.
   subroutine make_small(full, basis, places, loads, t, rests_are_kept, small, error)
      type(structure_t), intent(in) :: full
      type(krylov_basis_t), intent(in) :: basis
      integer, intent(in) :: places(:)
      type(named_vectors_t), intent(in) :: loads
      real(wp), intent(in) :: t(:, :)
      logical, intent(in) :: rests_are_kept
      type(structure_t), intent(out) :: small
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: damping(:, :), energy(:, :), mass(:, :), stiffness(:, :)
      character(label_length), allocatable :: labels(:)
      character(unit_length), allocatable :: units(:)
      integer :: i, n, p

      n = basis%n
      p = size(places)
      mass = matmul(transpose(t), matmul(basis%mass(:n, :n), t))
      energy = matmul(transpose(t), t)                                ! K_s
      call clear_coupling(mass)
      call clear_coupling(energy)
      energy(:p, p + 1:) = 0.0_wp
      energy(p + 1:, :p) = 0.0_wp
      stiffness = energy - basis%shift*mass
      damping = basis%alpha*mass + basis%beta*stiffness
      if (rests_are_kept) then
         call add_at_places(basis%remainder_of_damping, damping)
         call add_at_places(basis%remainder_of_stiffness, stiffness)
      else
         if (allocated(basis%damping)) damping = damping + matmul(transpose(t), matmul(basis%damping(:n, :n), t))
         if (allocated(basis%stiffness)) stiffness = stiffness + matmul(transpose(t), matmul(basis%stiffness(:n, :n), t))
      end if
      allocate (labels(n), units(n))
      labels(:p) = full%labels(places)
      units(:p) = full%units(places)
      units(p + 1:) = "m"
      do i = p + 1, n
         labels(i) = "q"//to_text(i - p)
      end do
      call new_structure(small, mass, damping, stiffness, labels, units, error)
      if (allocated(error)) return
      call keep_names(full, basis, places, loads, t, small)

   contains

      !> Symmetric, and without the rounding between shapes.
      subroutine clear_coupling(matrix)
         real(wp), intent(inout) :: matrix(:, :)
         real(wp) :: diagonal(n)
         integer :: k

         matrix = 0.5_wp*(matrix + transpose(matrix))
         diagonal = [(matrix(k, k), k=1, n)]
         matrix(p + 1:, p + 1:) = 0.0_wp
         do k = p + 1, n
            matrix(k, k) = diagonal(k)
         end do
      end subroutine clear_coupling

      subroutine add_at_places(remainder, matrix)
         type(sparse_t), intent(in) :: remainder
         real(wp), intent(inout) :: matrix(:, :)
         integer :: e, k

         if (remainder%n_entries() == 0) return
         do k = 1, p
            do e = remainder%first(places(k)), remainder%first(places(k) + 1) - 1
               associate (column => findloc(places, remainder%column(e), dim=1))
                  matrix(k, column) = matrix(k, column) + remainder%value(e)
               end associate
            end do
         end do
      end subroutine add_at_places
   end subroutine make_small

   !> Gives the small structure the sets of nodes, as far as their degrees of freedom are kept, and the loads.
   subroutine keep_names(full, basis, places, loads, t, small)
      type(structure_t), intent(in) :: full
      type(krylov_basis_t), intent(in) :: basis
      integer, intent(in) :: places(:)
      type(named_vectors_t), intent(in) :: loads
      real(wp), intent(in) :: t(:, :)
      type(structure_t), intent(inout) :: small
      real(wp) :: f(basis%n)
      integer :: e, i, k, n, p

      n = basis%n
      p = size(places)
      if (allocated(full%sets%names)) then
         small%sets%names = full%sets%names
         small%sets%first = full%sets%first
         small%sets%nodes = full%sets%nodes
         small%sets%node_of = [full%sets%node_of(places), spread(0, 1, n - p)]
         allocate (small%sets%direction(n))
         small%sets%direction = ""
         small%sets%direction(:p) = full%sets%direction(places)
      end if
      if (.not. allocated(loads%names)) return
      small%vectors%names = loads%names
      small%vectors%first = [(1 + k*n, k=0, size(loads%names))]
      allocate (small%vectors%values(0), small%vectors%dofs(0))
      do i = 1, size(loads%names)
         f = 0.0_wp
         do e = loads%first(i), loads%first(i + 1) - 1
            f = f + loads%values(e)*basis%v(loads%dofs(e), :n)
         end do
         small%vectors%values = [small%vectors%values, matmul(f, t)]
         small%vectors%dofs = [small%vectors%dofs, [(k, k=1, n)]]
      end do
   end subroutine keep_names
end module hb_reduction
