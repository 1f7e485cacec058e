!> What a whole finite element model with many contacts needs once for all frequencies: the factor of its stiffness with all
!> contacts closed and stuck, and its lowest modes in this state.
!>
!> With the functionals B of the n contact coordinates z = B x and the stiffness k of their laws, K_k = K + B^T k B is positive
!> definite also where only contact holds a part. Modes: K_k phi = lambda M phi, by a block Lanczos iteration with K_k^-1 M,
!> orthogonal in the mass. The damping must be a M + b K. Sources: docs/why/theory.md, section 4; B. N. Parlett, The Symmetric
!> Eigenvalue Problem, SIAM 1998, chapter 13 (blocks); B. Nour-Omid et al., Int. J. Numer. Meth. Eng. 19 (1983) 859
!> (spectral transformation).
module hb_contact_flexibility
   use hb_cholmod, only: cholesky_factor_t, has_cholmod
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, dpotrf, dsygv
   use hb_sparse, only: sparse_from_entries, sparse_sum, sparse_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: contact_flexibility_t, new_contact_flexibility, pays_to_factorise

   integer, parameter :: least_coordinates = 100             !! below, condensing them takes little memory
   integer, parameter :: dofs_per_coordinate = 4             !! of a model that is not reduced to its contacts
   integer, parameter :: entries_per_row = 20                !! of solids and shells; chains and beams condense to narrow bands
   integer, parameter :: block_width = 4                     !! right sides of a step of the iteration for modes
   integer, parameter :: vectors_together = 60               !! of this iteration, in memory: a multiple of `block_width`
   integer, parameter :: max_vectors = 480                   !! of it: modes up to the least margin suffice then
   real(wp), parameter :: least_margin = 1.5_wp              !! of the highest mode over the highest frequency
   real(wp), parameter :: mode_frequency_ratio = 2.2_wp      !! when modes are computed, over a frequency of `half_octave_above`
   real(wp), parameter :: projection_rounding = 1.0e-11_wp   !! relative

   !> Owner of external resources: call `destroy`.
   type :: contact_flexibility_t
      integer :: n_dofs = 0, n = 0
      type(coordinates_t) :: coordinates
      real(wp), allocatable :: contact(:)                    !! k [N/m], (n)
      type(sparse_t) :: mass                                 !! [kg]
      real(wp) :: by_mass = 0.0_wp, by_stiffness = 0.0_wp    !! a [1/s] and b [s] of the damping
      type(cholesky_factor_t) :: factor                      !! of K_k
      real(wp) :: n_in_factor = 0.0_wp                       !! its entries
      real(wp), allocatable :: shapes(:, :)                  !! phi, (n_dofs, n_modes), orthonormal in the mass
      real(wp), allocatable :: at_contacts(:, :)             !! B phi, (n, n_modes)
      real(wp), allocatable :: squares(:)                    !! lambda [rad**2/s**2], ascending, (n_modes)
      real(wp) :: up_to = -1.0_wp                            !! all modes below are there [rad/s]; < 0: none computed
      real(wp), private :: sought = -1.0_wp                  ! frequency below which modes were sought [rad/s]; < 0: none
      real(wp), private :: fingerprint(9) = 0.0_wp           ! of the matrices
   contains
      procedure :: is_of => contact_flexibility_is_of
      procedure :: cover => contact_flexibility_cover
      procedure :: destroy => contact_flexibility_destroy
   end type contact_flexibility_t

   !> Some vectors of the iteration for modes.
   type :: vectors_t
      real(wp), allocatable :: columns(:, :)                 !! (n_dofs, vectors_together)
   end type vectors_t

contains

   !> Whether a structure is a whole model of solids or shells with so many contact coordinates that its factor takes the place of
   !> their condensation.
   logical function pays_to_factorise(structure, coordinates)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates

      pays_to_factorise = has_cholmod() .and. allocated(structure%sparse) .and. .not. allocated(structure%parts) .and. &
                          coordinates%n >= least_coordinates .and. dofs_per_coordinate*coordinates%n <= structure%n_dofs
      if (pays_to_factorise) pays_to_factorise = structure%sparse%stiffness%n_entries() >= entries_per_row*structure%n_dofs
   end function pays_to_factorise

   !> Factorises the stiffness; not `is_possible` where it is not symmetric and positive definite, the damping is not of the form
   !> above, or there is not enough memory.
   subroutine new_contact_flexibility(self, structure, coordinates, contact, is_possible)
      type(contact_flexibility_t), intent(out) :: self
      type(structure_t), intent(in) :: structure             !! with sparse matrices
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: contact(:)                     !! [N/m], (coordinates%n), > 0
      logical, intent(out) :: is_possible
      type(sparse_t) :: stuck

      self%n_dofs = structure%n_dofs
      self%n = coordinates%n
      self%coordinates = coordinates
      self%contact = contact
      self%fingerprint = fingerprint_of(structure)
      call split_damping(self, structure, is_possible)
      if (is_possible) is_possible = structure%sparse%stiffness%is_symmetric()
      if (.not. is_possible) return
      self%mass = structure%sparse%mass
      stuck = sparse_sum(1.0_wp, structure%sparse%stiffness, 1.0_wp, contact_matrix(self))
      is_possible = self%factor%factorise(stuck%first, stuck%column, stuck%value, coordinates%dofs)
      self%n_in_factor = self%factor%bytes()/8.0_wp
   end subroutine new_contact_flexibility

   !> Whether it belongs to these matrices, coordinates and contacts.
   logical function contact_flexibility_is_of(self, structure, coordinates, contact) result(is_of)
      class(contact_flexibility_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: contact(:)

      is_of = self%n == coordinates%n .and. self%n_dofs == structure%n_dofs
      if (is_of) is_of = all(self%contact == contact) .and. coordinates%equal(self%coordinates)
      if (is_of) is_of = all(fingerprint_of(structure) == self%fingerprint)
   end function contact_flexibility_is_of

   !> Sums over the entries of the three matrices, with weights of their positions.
   function fingerprint_of(structure) result(sums)
      type(structure_t), intent(in) :: structure
      real(wp) :: sums(9)

      associate (s => structure%sparse)
         sums = [sums_of(s%stiffness), sums_of(s%mass), sums_of(s%damping)]
      end associate

   contains

      pure function sums_of(matrix) result(sums)
         type(sparse_t), intent(in) :: matrix
         real(wp) :: sums(3)
         integer :: e, i

         sums = 0.0_wp
         do i = 1, matrix%n_rows
            do e = matrix%first(i), matrix%first(i + 1) - 1
               associate (value => matrix%value(e))
                  sums = sums + value*[1.0_wp, real(i, wp), real(matrix%column(e), wp)]
               end associate
            end do
         end do
      end function sums_of
   end function fingerprint_of

   !> Finds a and b of the damping a M + b K by least squares; not possible if anything else remains.
   subroutine split_damping(self, structure, is_possible)
      type(contact_flexibility_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      logical, intent(out) :: is_possible
      real(wp), dimension(structure%n_dofs) :: d, k, m       ! a row of each matrix
      real(wp) :: determinant, dd, dk, dm, kk, km, mm, rest
      integer :: i

      is_possible = .true.
      associate (s => structure%sparse)
         if (s%damping%n_entries() == 0) return
         if (.not. maxval(abs(s%damping%value)) > 0.0_wp) return
         dd = 0.0_wp; dk = 0.0_wp; dm = 0.0_wp; kk = 0.0_wp; km = 0.0_wp; mm = 0.0_wp
         d = 0.0_wp
         k = 0.0_wp
         m = 0.0_wp
         do i = 1, structure%n_dofs
            call place(s%damping, i, d)
            call place(s%stiffness, i, k)
            call place(s%mass, i, m)
            dd = dd + product_in(s%damping, i, d)
            dk = dk + product_in(s%damping, i, k)
            dm = dm + product_in(s%damping, i, m)
            kk = kk + product_in(s%stiffness, i, k)
            km = km + product_in(s%stiffness, i, m)
            mm = mm + product_in(s%mass, i, m)
            call clear(s%damping, i, d)
            call clear(s%stiffness, i, k)
            call clear(s%mass, i, m)
         end do
         determinant = 1.0_wp - km*km/(kk*mm)
         if (determinant <= projection_rounding) then
            self%by_stiffness = dk/kk
         else
            self%by_stiffness = (dk - dm*km/mm)/(kk*determinant)
            self%by_mass = (dm - dk*km/kk)/(mm*determinant)
         end if
         rest = 0.0_wp
         do i = 1, structure%n_dofs
            call place(s%damping, i, d)
            call add(s%stiffness, i, -self%by_stiffness, d)
            call add(s%mass, i, -self%by_mass, d)
            call find_rest(s%damping)
            call find_rest(s%stiffness)
            call find_rest(s%mass)
         end do
         is_possible = rest <= 1.0e-9_wp*maxval(abs(s%damping%value))
         if (abs(self%by_mass)*sqrt(mm) <= projection_rounding*sqrt(dd)) self%by_mass = 0.0_wp
         if (abs(self%by_stiffness)*sqrt(kk) <= projection_rounding*sqrt(dd)) self%by_stiffness = 0.0_wp
      end associate

   contains

      !> Largest remainder in the columns of a row, which is cleared there.
      subroutine find_rest(matrix)
         type(sparse_t), intent(in) :: matrix
         integer :: e

         do e = matrix%first(i), matrix%first(i + 1) - 1
            rest = max(rest, abs(d(matrix%column(e))))
            d(matrix%column(e)) = 0.0_wp
         end do
      end subroutine find_rest
   end subroutine split_damping

   pure subroutine place(matrix, i, row)
      type(sparse_t), intent(in) :: matrix
      integer, intent(in) :: i
      real(wp), intent(inout) :: row(:)

      call add(matrix, i, 1.0_wp, row)
   end subroutine place

   pure subroutine add(matrix, i, factor, row)
      type(sparse_t), intent(in) :: matrix
      integer, intent(in) :: i
      real(wp), intent(in) :: factor
      real(wp), intent(inout) :: row(:)
      integer :: e

      do e = matrix%first(i), matrix%first(i + 1) - 1
         row(matrix%column(e)) = row(matrix%column(e)) + factor*matrix%value(e)
      end do
   end subroutine add

   pure subroutine clear(matrix, i, row)
      type(sparse_t), intent(in) :: matrix
      integer, intent(in) :: i
      real(wp), intent(inout) :: row(:)

      row(matrix%column(matrix%first(i):matrix%first(i + 1) - 1)) = 0.0_wp
   end subroutine clear

   pure real(wp) function product_in(matrix, i, row)
      type(sparse_t), intent(in) :: matrix
      integer, intent(in) :: i
      real(wp), intent(in) :: row(:)
      integer :: e

      product_in = 0.0_wp
      do e = matrix%first(i), matrix%first(i + 1) - 1
         product_in = product_in + matrix%value(e)*row(matrix%column(e))
      end do
   end function product_in

   !> A vector that is orthogonal to no mode.
   pure function probe(n, number)
      integer, intent(in) :: n, number
      real(wp) :: probe(n)
      integer :: i

      probe = [(cos((1.0_wp + 0.618_wp*number)*i + number), i=1, n)]
   end function probe

   !> B^T k B.
   function contact_matrix(self) result(matrix)
      type(contact_flexibility_t), intent(in) :: self
      type(sparse_t) :: matrix
      integer, allocatable :: at(:), column(:), row(:)
      real(wp), allocatable :: value(:), weights(:)
      integer :: e, f, i, n, pass

      do pass = 1, 2
         n = 0
         do i = 1, self%n
            call self%coordinates%find_functional(i, at, weights)
            if (pass == 2) then
               do e = 1, size(at)
                  do f = 1, size(at)
                     row(n + (e - 1)*size(at) + f) = self%coordinates%dofs(at(e))
                     column(n + (e - 1)*size(at) + f) = self%coordinates%dofs(at(f))
                     value(n + (e - 1)*size(at) + f) = self%contact(i)*weights(e)*weights(f)
                  end do
               end do
            end if
            n = n + size(at)**2
         end do
         if (pass == 1) allocate (row(n), column(n), value(n))
      end do
      matrix = sparse_from_entries(self%n_dofs, row, column, value)
   end function contact_matrix

   !> Computes the modes that responses up to a frequency need, unless they are there; `is_covered` is false if there are too many.
   !> A new point has those of its frequency alone: its numbers do not depend on what was computed before.
   subroutine contact_flexibility_cover(self, frequency, is_covered, is_new_point)
      class(contact_flexibility_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                      !! [rad/s]
      logical, intent(out) :: is_covered
      logical, intent(in), optional :: is_new_point          !! default: more modes than needed may be there
      real(wp) :: seek
      logical :: is_sought

      seek = mode_frequency_ratio*half_octave_above(frequency)
      is_sought = self%sought >= seek
      if (present(is_new_point)) is_sought = is_sought .and. .not. (is_new_point .and. self%sought > seek)
      if (self%sought >= 0.0_wp .and. self%up_to < self%sought .and. seek > self%sought) is_sought = .true.   ! by all vectors
      if (.not. is_sought) then
         call find_modes(self, seek)
         self%sought = seek
      end if
      is_covered = self%up_to >= least_margin*frequency
   end subroutine contact_flexibility_cover

   !> The next frequency of a scale that has two in an octave: points with similar frequencies share their modes.
   pure real(wp) function half_octave_above(frequency)
      real(wp), intent(in) :: frequency
      real(wp), parameter :: of_rounding = 1.0e-9_wp

      half_octave_above = frequency
      if (frequency > 0.0_wp) half_octave_above = 2.0_wp**(0.5_wp*ceiling(2.0_wp*log(frequency)/log(2.0_wp) - of_rounding))
   end function half_octave_above

   !> Computes all modes below a frequency; with the most vectors, or if there is not enough memory, those that are accurate.
   subroutine find_modes(self, frequency)
      type(contact_flexibility_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                      !! [rad/s]
      type(vectors_t) :: v(max_vectors/vectors_together)
      real(wp), allocatable :: h(:, :), s(:, :), theta(:), w(:, :)
      real(wp) :: r(block_width, block_width)
      integer :: i, n, n_found, next
      logical :: is_over

      allocate (w(block_width, self%n_dofs), h(0, 0))
      do i = 1, block_width
         w(i, :) = probe(self%n_dofs, i)
      end do
      call respond(self, w)
      call orthonormalise(self, w, r, is_over)
      n = 0
      n_found = 0
      next = 4*block_width
      do
         call append(w, n, v, h, is_over)
         if (is_over) exit
         n = n + block_width
         call respond(self, w)
         do i = 1, 2
            call remove(self, v, w, h(:n, n - block_width + 1:n))
         end do
         call orthonormalise(self, w, r, is_over)
         is_over = is_over .or. n + block_width > min(max_vectors, self%n_dofs)
         if (.not. (is_over .or. n >= next)) cycle
         next = n + 4*block_width
         call find_ritz(h(:n, :n), theta, s)
         n_found = converged(r, theta, s)
         if (is_over) exit
         if (n_found == 0 .or. n_found == n) cycle
         if (1.0_wp/theta(n_found) > frequency**2) exit
      end do
      if (size(theta) < n) then                              ! out of memory between two examinations
         call find_ritz(h(:n, :n), theta, s)
         n_found = converged(r, theta, s)
      end if
      call store_modes(self, v, theta, s, n_found)
   end subroutine find_modes

   !> Appends the block W to n vectors and makes room in their matrix; `is_over` without memory.
   subroutine append(w, n, v, h, is_over)
      real(wp), intent(in) :: w(:, :)                        !! (block, n_dofs)
      integer, intent(in) :: n
      type(vectors_t), intent(inout) :: v(:)
      real(wp), intent(inout), allocatable :: h(:, :)
      logical, intent(out) :: is_over
      real(wp), allocatable :: larger(:, :)
      integer :: k, stat

      stat = 0
      associate (chunk => n/vectors_together + 1, at => mod(n, vectors_together))
         if (.not. allocated(v(chunk)%columns)) allocate (v(chunk)%columns(size(w, 2), vectors_together), stat=stat)
         if (stat == 0 .and. n + block_width > size(h, 1)) &
            allocate (larger(2*n + block_width, 2*n + block_width), stat=stat, source=0.0_wp)
         is_over = stat /= 0
         if (is_over) return
         do k = 1, block_width
            v(chunk)%columns(:, at + k) = w(k, :)
         end do
      end associate
      if (.not. allocated(larger)) return
      larger(:n, :n) = h(:n, :n)
      call move_alloc(larger, h)
   end subroutine append

   !> W = W M K_k^-1.
   subroutine respond(self, w)
      type(contact_flexibility_t), intent(in) :: self
      real(wp), intent(inout), allocatable :: w(:, :)        !! (block, n_dofs)
      real(wp), allocatable :: forces(:, :)

      allocate (forces, mold=w)
      call self%mass%times(w, forces)
      call self%factor%solve(forces)
      call move_alloc(forces, w)
   end subroutine respond

   !> Removes from W its components along vectors, which are added to `along`.
   subroutine remove(self, v, w, along)
      type(contact_flexibility_t), intent(in) :: self
      type(vectors_t), intent(in) :: v(:)                    !! orthonormal in the mass
      real(wp), intent(inout), contiguous :: w(:, :)         !! (block, n_dofs)
      real(wp), intent(inout) :: along(:, :)                 !! (number of vectors, block)
      real(wp) :: components(block_width, vectors_together)
      real(wp), allocatable :: mw(:, :)
      integer :: first, m

      allocate (mw, mold=w)
      call self%mass%times(w, mw)
      do first = 0, size(along, 1) - 1, vectors_together
         m = min(vectors_together, size(along, 1) - first)
         associate (n => size(w, 2), columns => v(first/vectors_together + 1)%columns)
            call dgemm("N", "N", block_width, m, n, 1.0_wp, mw, block_width, columns, n, 0.0_wp, components, block_width)
            call dgemm("N", "T", block_width, n, m, -1.0_wp, components, block_width, columns, n, 1.0_wp, w, block_width)
         end associate
         along(first + 1:first + m, :) = along(first + 1:first + m, :) + transpose(components(:, :m))
      end do
   end subroutine remove

   !> Makes W orthonormal in the mass, W = R^T W_new; `is_over` if its rows depend on each other to rounding.
   subroutine orthonormalise(self, w, r, is_over)
      type(contact_flexibility_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: w(:, :)         !! (block, n_dofs)
      real(wp), intent(out) :: r(block_width, block_width)
      logical, intent(out) :: is_over
      real(wp) :: factor(block_width, block_width)
      real(wp), allocatable :: mw(:, :)
      integer :: i, info, k, pass

      allocate (mw, mold=w)
      r = 0.0_wp
      do i = 1, block_width
         r(i, i) = 1.0_wp
      end do
      do pass = 1, 2                                         ! the second one removes the rounding of the first
         call self%mass%times(w, mw)
         associate (n => size(w, 2))
            call dgemm("N", "T", block_width, block_width, n, 1.0_wp, w, block_width, mw, block_width, 0.0_wp, factor, block_width)
         end associate
         call dpotrf("U", block_width, factor, block_width, info)
         is_over = info /= 0
         if (is_over) return
         do k = 1, block_width
            factor(k + 1:, k) = 0.0_wp
         end do
         do i = 1, size(w, 2)
            do k = 1, block_width
               w(k, i) = (w(k, i) - dot_product(factor(:k - 1, k), w(:k - 1, i)))/factor(k, k)
            end do
         end do
         r = matmul(factor, r)
      end do
   end subroutine orthonormalise

   !> Ritz values of K_k^-1 M, descending, and their vectors in the basis.
   subroutine find_ritz(h, theta, s)
      real(wp), intent(in) :: h(:, :)                        !! (n, n), its upper blocks
      real(wp), allocatable, intent(out) :: theta(:), s(:, :)
      real(wp), allocatable :: unit(:, :), values(:), vectors(:, :), work(:)
      integer :: i, info, n

      n = size(h, 1)
      allocate (unit(n, n), values(n), work(34*n), source=0.0_wp)
      allocate (vectors, source=h)
      do i = 1, n
         unit(i, i) = 1.0_wp
      end do
      call dsygv(1, "V", "U", n, vectors, n, unit, n, values, work, size(work), info)
      theta = values(n:1:-1)
      s = vectors(:, n:1:-1)
   end subroutine find_ritz

   !> Number of the largest Ritz values that are accurate.
   pure integer function converged(r, theta, s)
      real(wp), intent(in) :: r(:, :)                        !! of the next block
      real(wp), intent(in) :: theta(:), s(:, :)
      integer :: i, n

      n = size(theta)
      converged = 0
      do i = 1, n
         if (norm2(matmul(r, s(n - block_width + 1:n, i))) > projection_rounding*theta(i)) return
         converged = i
      end do
   end function converged

   subroutine store_modes(self, v, theta, s, n_found)
      type(contact_flexibility_t), intent(inout) :: self
      type(vectors_t), intent(inout) :: v(:)                 !! freed
      real(wp), intent(in) :: theta(:), s(:, :)
      integer, intent(in) :: n_found
      real(wp), allocatable :: of_basis(:, :)
      integer :: first, m

      if (allocated(self%shapes)) deallocate (self%shapes, self%at_contacts)
      allocate (self%shapes(self%n_dofs, n_found), source=0.0_wp)
      self%squares = 1.0_wp/theta(:n_found)
      self%up_to = 0.0_wp
      if (n_found > 0) self%up_to = sqrt(self%squares(n_found))
      do first = 0, size(theta) - 1, vectors_together
         m = min(vectors_together, size(theta) - first)
         of_basis = s(first + 1:first + m, :n_found)
         associate (n => self%n_dofs, columns => v(first/vectors_together + 1)%columns)
            call dgemm("N", "N", n, n_found, m, 1.0_wp, columns, n, of_basis, m, 1.0_wp, self%shapes, n)
         end associate
         deallocate (v(first/vectors_together + 1)%columns)
      end do
      self%at_contacts = transpose(self%coordinates%values_of(transpose(self%shapes(self%coordinates%dofs, :))))
   end subroutine store_modes

   !> Frees the factor; safe to call twice.
   subroutine contact_flexibility_destroy(self)
      class(contact_flexibility_t), intent(inout) :: self

      call self%factor%destroy()
   end subroutine contact_flexibility_destroy
end module hb_contact_flexibility
